"""The contract of estimators, and how one is loaded when it is used."""

from __future__ import annotations

from importlib import import_module
from typing import Protocol

from palpate.errors import InputError
from palpate.estimation.estimate import Estimate
from palpate.mjcf.body import Body
from palpate.parameter import Parameter
from palpate.trace.samples import Trace


class Estimator(Protocol):
    """Function that estimates one quantity from a trace and from no other measurement.

    Whatever it needs it looks up in the trace: `trace.converted(parameter)` is the recording that a
    conversion declared to stand for the parameter, `trace.recordings` all of them with their
    context. Without it, it returns `not_measured` or `not_identified`, which say why.
    """

    def __call__(self, trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
        """The estimate.

        Args:
            trace: samples, leaves and recordings; the truth of a simulated world is not among them.
            parameter: what is to be estimated; of this estimator's quantity.
            body: what the scene states about the parameter's object; None where it is no body of
                the scene (the gripper).

        Raises:
            ValueError: a recording that is no evidence: without samples, or not what it declares.
        """
        ...


Reference = str
"""`package.module:function`: an estimator that is imported when it is used."""


def load_estimator(reference: Reference) -> Estimator:
    """The estimator behind a reference.

    Raises:
        InputError: it cannot be loaded; the message names it.
    """
    module, _, function = reference.partition(":")
    try:
        return getattr(import_module(module), function)
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        raise InputError(
            f"the estimator '{reference}' cannot be loaded: {reason}; "
            "repair or uninstall the package that brings it"
        ) from error
