"""Accuracy of an arm as its datasheet states it: all that estimation may rely on.

An arm's description states it. A noise model's `datasheet` section states it of the arm in its
world, whatever that world is like.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Annotated

from pydantic import BeforeValidator, Field

from palpate.files.plain_yaml import Section, plain_number
from palpate.robots.description import RobotDescription

Stated = Annotated[float, BeforeValidator(plain_number), Field(ge=0, allow_inf_nan=False)]


class Datasheet(Section):
    """Stated accuracies; None is what the arm's description says.

    Attributes:
        force_resolution: N.
        force_repeatability: N, per approach.
        force_accuracy: N, of a force that is referred to nothing.
        pose_repeatability: m.
        torque_gain_max: relative, half width.
        tip_offset: m, from the TCP to the pads' end along the tool.
        tip_offset_std: m, how well that is known.
        tip_compliance: m/N, of pads and joints beyond the encoders, under a force along the tool.
        tip_compliance_std: m/N, how well that is known.
    """

    force_resolution: Stated | None = None
    force_repeatability: Stated | None = None
    force_accuracy: Stated | None = None
    pose_repeatability: Stated | None = None
    torque_gain_max: Stated | None = None
    tip_offset: Stated | None = None
    tip_offset_std: Stated | None = None
    tip_compliance: Stated | None = None
    tip_compliance_std: Stated | None = None


def informed(arm: RobotDescription, sheet: Datasheet) -> RobotDescription:
    """The arm as its owner knows it: the description, where `sheet` says nothing else. One and the
    same for the same figures, as what is computed of it is kept."""
    told = arm.nominal
    said: dict[str, float] = sheet.model_dump(exclude_none=True)
    if "torque_gain_max" in said:
        said["torque_gain"] = said.pop("torque_gain_max")
    new = {name: value for name, value in said.items() if getattr(told, name) != value}
    return _informed(arm, tuple(sorted(new.items()))) if new else arm


@cache
def _informed(arm: RobotDescription, said: tuple[tuple[str, float], ...]) -> RobotDescription:
    return replace(arm, nominal=replace(arm.nominal, **dict(said)))
