"""Estimate: a value with unit, uncertainty and verdict; tests of fit; points of a fit for charts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from html import escape
from itertools import chain
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.common.display import data_frame
from palpate.common.parameter import ByParameter, Parameter
from palpate.common.pose import Array
from palpate.trace.recording import Recording
from palpate.trace.samples import Samples, Trace

if TYPE_CHECKING:
    from pandas import DataFrame


FALSE_ALARM = 1e-4
"""Probability that one test of fit fails although the model holds. An estimate has up to ten tests, and about a
thousand valid estimates in a row should stay identified. Sensitive: no."""


KNOWN = 1_000_000_000
"""Degrees of freedom of a known variance."""
OUTSIDE = 0.05
"""Probability outside a one-sided limit."""


@dataclass(frozen=True, slots=True)
class FitTest:
    """Goodness-of-fit test: a statistic against its limit."""

    name: str  # subject of the test, e.g. `up against down`.
    statistic: float  # size of the deviation
    limit: float  # largest statistic that passes
    finding: str  # one sentence for people on the deviation; shown where the test fails

    @property
    def passed(self) -> bool:
        """True if the statistic is within its limit; a NaN is not."""
        return bool(self.statistic <= self.limit)  # numpy's bool is not JSON serializable


def chi_squared(
    name: str, statistic: float, freedom: int, finding: str, noise_freedom: float = KNOWN
) -> FitTest:
    """Chi-squared test of a sum of `freedom` squares, each of unit variance where the model holds.

    Chance exceeds the limit with probability `FALSE_ALARM`. The variance was itself estimated with `noise_freedom`
    degrees of freedom, so that the sum over `freedom` has an F distribution.
    """
    from scipy.special import fdtri

    limit = freedom * float(fdtri(freedom, noise_freedom, 1.0 - FALSE_ALARM))
    return FitTest(name, statistic, limit, finding)


@dataclass(frozen=True, slots=True)
class Bound:
    """Physical bound of a value: a lower one, or an upper one with `sign` -1, which is mirrored."""

    at: float
    sign: Literal[1, -1] = 1

    @property
    def words(self) -> str:
        """Direction of the one-sided limit of a value near the bound."""
        return "at most" if self.sign > 0 else "at least"

    def limit(self, value: float, std: float, freedom: float = math.inf) -> float:
        """Compute the one-sided 95 % limit u of a value that is not below the bound b, estimated as `value` ± `std`.

        u solves P(T > (u - value) / std) = 0.05 P(T < (value - b) / std) with Student's T of `freedom` degrees of
        freedom. This is the CLs limit, and the Bayesian one with a flat prior above b (A. L. Read, J. Phys. G 28,
        2693, 2002). It is never below b, and it covers the truth with 95 % or more wherever that is.
        """
        from scipy.special import ndtr, ndtri, stdtr, stdtrit

        # Mirror an upper bound, then invert the truncated distribution.
        away = self.sign * (value - self.at) / std
        if math.isinf(freedom):
            quantile = float(ndtri(OUTSIDE * ndtr(away)))
        else:
            quantile = float(stdtrit(freedom, OUTSIDE * stdtr(freedom, away)))
        return value - self.sign * std * quantile

    def moments(self, value: float, std: float) -> tuple[float, float]:
        """Mean and standard deviation of a normal variable, given that it is not below the bound b.

        Let alpha = (b - value) / std, and h = pdf(alpha) / (1 - cdf(alpha)) the hazard of the standard normal. They
        are value + std h and std sqrt(1 + alpha h - h²) (Johnson, Kotz and Balakrishnan, Continuous Univariate
        Distributions 1, section 10.1).
        """
        from scipy.special import log_ndtr

        alpha = self.sign * (self.at - value) / std
        hazard = math.exp(-0.5 * alpha**2 - float(log_ndtr(-alpha))) / math.sqrt(2.0 * math.pi)
        spread = std * math.sqrt(max(1.0 + alpha * hazard - hazard**2, 1e-6))
        return value + self.sign * std * hazard, spread


def reached_bound(low: float, high: float, bounds: tuple[float, float]) -> Bound | None:
    """Bound of `bounds` (least and largest) that the interval from `low` to `high` reaches.

    Returns None if it reaches neither, and for an exact value, whose interval has no width.
    """
    if low == high:
        return None
    if low <= bounds[0]:
        return Bound(bounds[0])
    return Bound(bounds[1], -1) if high >= bounds[1] else None


# Measured values of a fit and its predictions, for charts


VIEW_CLOSING = 0.4
"""s. A chart of a grasp begins this long before the fingers close. Sensitive: no."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FitView:
    """Chart of one fit: measured values, predictions and standard deviations."""

    name: str  # title
    note: str  # one or two sentences that explain the chart
    axes: tuple[str, str]  # labels of `x` and of the values, each with its unit
    x: Array  # (n,) abscissa
    # measured, predicted: (n,) in one unit; NaN in `measured` breaks a curve
    measured: Array
    predicted: Array
    # (n,) of `measured` about `predicted`, or one for all; 0 where it is not stated.
    std: Array | float = 0.0
    used: Mask | None = None  # (n,) rows that the fit uses; None for all
    # (n,) words for the legend, at most three different ones, or one for all.
    groups: Sequence[str] | str = "measured"
    # (n, p) derivatives of `predicted` by the p components of the estimate, for its interval and
    # the truth; None where the estimate does not determine `predicted`.
    slopes: Array | None = None


def constant(value: float, like: ArrayLike) -> Array:
    """Prediction (n,) of `value` at every point of `like`."""
    return np.full(len(np.atleast_1d(like)), value)


def unit_slopes(like: ArrayLike, component: int = 0, of: int = 1, scale: float = 1.0) -> Array:
    """Slopes (n, of) of predictions that equal `scale` times a `component` of the estimate."""
    return np.tile(scale * np.eye(of)[component], (len(np.atleast_1d(like)), 1))


def closing_samples(trace: Trace, recording: Recording) -> Samples | None:
    """Samples from shortly before the fingers closed to the end of a recording of a held object.

    Returns None if they never closed.
    """
    closed = [leaf for leaf in trace.leaf_runs("CloseGripper") if leaf.end <= recording.start]
    if recording.context.holding is None or not closed:
        return None
    return trace.samples.between(closed[-1].start - VIEW_CLOSING, recording.end)


# Estimate: a value with its unit, uncertainty and verdict


Verdict = Literal["identified", "prior-dominated", "contradicted", "not identified"]

AXES = {1: ("",), 2: ("x", "y"), 3: ("x", "y", "z"), 6: ("xx", "yy", "zz", "xy", "xz", "yz")}
"""Names of the components of a vector, and of a symmetric tensor in the order of MuJoCo's `fullinertia`."""
Z95 = 1.96
"""Half width of the central 95 % interval of a normal distribution, in standard deviations."""
BELIEVED = "the recordings say no more than what was believed before"
UNSEEN = "the recordings hardly observe it"
AS_WIDE = "the interval is no narrower than the prior's"
AT_BOUND = "the 95 % interval reaches a physical bound"
"""Reasons of a prior-dominated value: the default, unobserved components, a wide interval, and a bound."""
UNBOUNDED = (-math.inf, math.inf)


def axes_of(count: int) -> tuple[str, ...]:
    """Names of `count` components."""
    return AXES.get(count, tuple(str(i + 1) for i in range(count)))


def half95(freedom: float) -> float:
    """Half width of the central 95 % interval of Student's t, in standard deviations; `freedom` may be infinite."""
    from scipy.special import stdtrit  # takes longer to load than most plans to make

    return Z95 if math.isinf(freedom) else float(stdtrit(freedom, 0.975))


@dataclass(frozen=True, slots=True)
class FurtherValue:
    """Additional result of an estimate, such as the static friction with the dynamic one.

    `unit` is None where it is that of the estimate.
    """

    value: float
    std: float
    unit: str | None = None


@dataclass(frozen=True, slots=True)
class Shared:
    """Error cause that an estimate shares with other estimates, so that averaging does not reduce it.

    Attributes:
        cause: e.g. `gain of joint 4`; two estimates share it where `cause` and `of` are equal.
        of: `arm`, the same in all runs of one arm, or `scene`, in all runs with one description.
        effect: (n,) signed change of each component by one standard deviation of the cause, in the estimate's
            unit.
    """

    cause: str
    of: Literal["arm", "scene"]
    effect: tuple[float, ...]


def map_shared(shared: Iterable[Shared], slopes: Array) -> tuple[Shared, ...]:
    """Errors of a function of an estimate, with the derivatives `slopes` (k, n), from those of the estimate."""
    return tuple(
        replace(one, effect=tuple((slopes @ np.array(one.effect)).tolist())) for one in shared
    )


def add_shared(*parts: Sequence[Shared]) -> tuple[Shared, ...]:
    """Add the effects of each cause, for an estimate that is the sum of several."""
    found: dict[tuple[str, Literal["arm", "scene"]], Array] = {}
    for one in chain.from_iterable(parts):
        found[one.cause, one.of] = found.get((one.cause, one.of), 0.0) + np.array(one.effect)
    return tuple(Shared(*key, tuple(effect.tolist())) for key, effect in found.items())


COLUMNS = ("parameter", "value ± std", "95 % interval", "verdict")
"""Headings of `Estimate.cells`."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Estimate:
    """Measured quantity with its uncertainty; usually built by `normal`. The arrays are read-only.

    Attributes:
        parameter: the estimated parameter.
        unit: SI unit of all numbers, as printed; `1` for a dimensionless quantity.
        values: (n,) one number per component; empty when not identified.
        stds: (n,) standard deviations.
        intervals: (n, 2) low and high end of each component's central 95 % interval. Like `values` they are
            unconstrained: those of a mass may be negative. See `physical`.
        method: a sentence or two for people on the method and the recordings.
        evidence: recordings that were used, for the report's plots.
        verdict: `identified`; `prior-dominated` where the recordings add little to the prior, or the interval
            reaches a bound; `contradicted` where a test of fit failed, regardless of the estimator;
            `not identified`, without a value. Only an identified value counts as measured.
        parts: further values by name, e.g. `static` and `dynamic`; `components` in `result.json`.
        tests: tests of fit, passed or not.
        shared: parts of `stds` that other runs share, cause by cause.
        freedom: degrees of freedom of the noise in the rest of it; `intervals` uses them.
        unseen: components without evidence in the recordings, which keep their prior; the verdict is that of the
            others.
        views: charts of the fit; not part of `result.json`.
        reason: a phrase on why it, or a component of it, is prior-dominated; else empty.
        bounds: least and largest physically possible value, of all components or of each.
        simulated: the values are those of a simulation, which its texts say.
    """

    parameter: Parameter
    unit: str
    values: Array
    stds: Array
    intervals: Array
    method: str
    evidence: tuple[Recording, ...] = ()
    verdict: Verdict = "identified"
    parts: Mapping[str, FurtherValue] = field(default_factory=dict[str, FurtherValue])
    tests: tuple[FitTest, ...] = ()
    shared: tuple[Shared, ...] = ()
    freedom: float = math.inf
    unseen: tuple[int, ...] = ()
    views: tuple[FitView, ...] = ()
    reason: str = ""
    bounds: tuple[float, float] | tuple[tuple[float, float], ...] = UNBOUNDED
    simulated: bool = False

    @classmethod
    def normal(
        cls,
        parameter: Parameter,
        unit: str,
        value: ArrayLike,
        std: ArrayLike,
        method: str,
        evidence: tuple[Recording, ...] = (),
        verdict: Verdict = "identified",
        parts: Mapping[str, FurtherValue] | None = None,
        tests: tuple[FitTest, ...] = (),
        shared: tuple[Shared, ...] = (),
        freedom: float = math.inf,
        unseen: tuple[int, ...] = (),
        views: tuple[FitView, ...] = (),
        reason: str = "",
    ) -> Estimate:
        """Build an estimate with normal intervals, or with those of Student's t for finite `freedom`.

        An estimate with a `reason` is prior-dominated.
        """
        return cls(
            parameter,
            unit,
            np.atleast_1d(value),
            np.atleast_1d(std),
            interval95(value, std, freedom),
            method,
            evidence,
            "prior-dominated" if reason else verdict,
            parts or {},
            tests,
            shared,
            freedom,
            unseen,
            views,
            reason,
        )

    def __post_init__(self) -> None:
        # Store the numbers as read-only arrays of the documented shapes.
        for name, shape in (("values", -1), ("stds", -1), ("intervals", (-1, 2))):
            numbers = np.array(getattr(self, name), dtype=np.float64).reshape(shape)
            numbers.flags.writeable = False
            object.__setattr__(self, name, numbers)
        # Check the consistency of numbers and verdict; a failed test overrides the estimator's verdict.
        if not len(self.values) == len(self.stds) == len(self.intervals):
            raise ValueError(f"{self.parameter}: value, std and ci95 differ in length")
        if self.has_value == (self.verdict == "not identified"):
            raise ValueError(f"{self.parameter}: {self.verdict}, with value {self.values}")
        if self.has_value and self.contradiction:
            object.__setattr__(self, "verdict", "contradicted")
        elif self.verdict == "contradicted":
            raise ValueError(f"{self.parameter}: contradicted, though no test of fit failed")
        # An interval at a bound for all components leaves nothing identified.
        if self.identified:
            reason = UNSEEN if self.unseen else AT_BOUND if any(self.at_bound) else ""
            object.__setattr__(self, "reason", reason)
            if all(self.at_bound):
                object.__setattr__(self, "verdict", "prior-dominated")
        elif self.verdict == "prior-dominated" and not self.reason:
            object.__setattr__(self, "reason", BELIEVED)

    def bounded(self, bounds: tuple[float, float] | tuple[tuple[float, float], ...]) -> Estimate:
        """Copy with physical `bounds`; a value too far beyond them is contradicted."""
        if not self.has_value:
            return self
        # Chi-squared of the distances beyond the bounds, in standard deviations.
        low, high = np.broadcast_to(np.array(bounds), (len(self.values), 2)).T
        beyond = np.maximum(low - self.values, self.values - high)
        squares = np.square(np.maximum(beyond, 0.0) / np.maximum(self.stds, 1e-300))
        if not np.isfinite(beyond).any():
            return self
        test = chi_squared(
            "physical bound",
            float(squares.sum()),
            int(np.isfinite(beyond).sum()),
            f"The {self.parameter.quantity} comes out farther below or above what is possible than its errors explain.",
            min(KNOWN, self.freedom),
        )
        return replace(self, bounds=bounds, tests=(*self.tests, test))

    @property
    def value(self) -> float | Array:
        """Number of a scalar quantity, or (n,) numbers of a vector; NaN if not identified."""
        return _of_scalar(self.values)

    @property
    def std(self) -> float | Array:
        """Standard deviation, in the shape of `value`."""
        return _of_scalar(self.stds)

    @property
    def ci95(self) -> tuple[float, float] | Array:
        """Central 95 % interval: (low, high) of a scalar quantity, (n, 2) of a vector."""
        if len(self.values) != 1:
            return self.intervals
        low, high = self.intervals[0].tolist()
        return low, high

    def __float__(self) -> float:
        """Convert a scalar quantity to its value. Raises TypeError: there is no value, or it is a vector."""
        if len(self.values) != 1:
            what = f"a vector of {len(self.values)}" if self.has_value else self.verdict
            raise TypeError(f"{self.parameter} is {what}, not a number")
        return float(self.values[0])

    @property
    def has_value(self) -> bool:
        """True if there is a value; False if not identified."""
        return len(self.values) > 0

    @property
    def identified(self) -> bool:
        """True if the estimate counts as measured."""
        return self.verdict == "identified"

    @property
    def is_evidence(self) -> bool:
        """True if the value rests on the recordings alone: identified, or prior-dominated only by a bound.

        Such values are fused and scored. A selection by distance from the bound would select by the error.
        """
        # The reason may carry advice: "CAUSE; ADVICE".
        return self.identified or self.reason.partition(";")[0] == AT_BOUND

    @property
    def at_bound(self) -> tuple[Bound | None, ...]:
        """(n,) physical bound that the 95 % interval of a component reaches, so that it is not excluded.

        None for other components, and where a test of fit contradicts the value.
        """
        # A contradicted or missing value has no bounds; others compare each interval with its bounds.
        bounds = self.bounds if self.verdict in ("identified", "prior-dominated") else UNBOUNDED
        each = np.broadcast_to(np.array(bounds), (len(self.values), 2)).tolist()
        pairs = zip(self.intervals.tolist(), each, strict=True)
        return tuple(reached_bound(low, high, bound) for (low, high), bound in pairs)

    @property
    def limits(self) -> tuple[float | None, ...]:
        """(n,) one-sided 95 % limit of each component at a bound; None where no bound acts."""
        found: list[float | None] = []
        for i, bound in enumerate(self.at_bound):
            value, std = float(self.values[i]), float(self.stds[i])
            found.append(None if bound is None else bound.limit(value, std, self.freedom))
        return tuple(found)

    @property
    def physical(self) -> Estimate:
        """Estimate for a twin: a scalar at a bound gets its mean, deviation and interval given the bound.

        A vector stays unchanged, because its components belong together.
        """
        bound = self.at_bound[0] if len(self.values) == 1 else None
        if bound is None:
            return self
        # Moments of the truncated normal distribution, and the interval from the bound to its limit.
        moments = np.array(bound.moments(float(self.values[0]), float(self.stds[0])))
        ends = np.sort(np.array([bound.at, self.limits[0]], dtype=np.float64))
        return replace(self, values=moments[:1], stds=moments[1:], intervals=ends, bounds=UNBOUNDED)

    @property
    def whole(self) -> Verdict:
        """Verdict of all components together: prior-dominated if one is unseen or at a bound."""
        return "prior-dominated" if self.identified and self.reason else self.verdict

    @property
    def doubtful_axes(self) -> tuple[str, ...]:
        """Names of the components of a vector that are not identified."""
        pairs = zip(axes_of(len(self.values)), self.verdicts, strict=True)
        return tuple(axis for axis, verdict in pairs if verdict != "identified")

    @property
    def verdict_in_words(self) -> str:
        """The verdict, with the axes that it applies to where others are unseen."""
        if self.whole == self.verdict:
            return self.verdict
        # List the identified axes, then the others.
        doubtful = self.doubtful_axes
        seen = [axis for axis in axes_of(len(self.values)) if axis not in doubtful]
        return f"{', '.join(seen)} identified, {', '.join(doubtful)} prior-dominated"

    @property
    def doubt(self) -> str:
        """Reason of a prior-dominated estimate or component, after the limits of those at a bound; else empty."""
        limits = [self.limit_in_words(i) for i in range(len(self.values))]
        said = ", ".join(f"{limit}{_suffix(self.unit)}" for limit in limits if limit)
        return f"{said} (95 %): {self.reason}" if said and self.reason else self.reason

    @property
    def verdicts(self) -> tuple[Verdict, ...]:
        """(n,) verdict of each component."""
        found: list[Verdict] = [self.verdict] * len(self.values)
        if self.identified:
            # Unseen components and those at a bound keep their prior.
            for component, bound in enumerate(self.at_bound):
                if bound or component in self.unseen:
                    found[component] = "prior-dominated"
        return tuple(found)

    @property
    def shared_std(self) -> Array:
        """(n,) part of `std` that other runs share."""
        effects = [one.effect for one in self.shared]
        squares = np.square(np.array(effects).reshape(-1, len(self.values)))
        return np.minimum(np.sqrt(squares.sum(axis=0)), self.stds)

    @property
    def contradiction(self) -> str:
        """Findings of the failed tests, joined; empty if all passed."""
        return " ".join(test.finding for test in self.tests if not test.passed)

    def z_score(self, truth: ArrayLike) -> float | Array:
        """Error in standard deviations against a `truth` in the estimate's unit, in the shape of `value`."""
        return _of_scalar((self.values - np.atleast_1d(truth)) / self.stds)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Estimate):
            return NotImplemented
        # Views are derived from the numbers, and charts are not part of the result.
        arrays = {"values", "stds", "intervals", "bounds"}
        plain = {one.name for one in fields(self)} - arrays - {"views", "simulated"}
        return all(getattr(self, name) == getattr(other, name) for name in plain) and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in arrays
        )

    def __repr__(self) -> str:
        label = ", simulated" * self.simulated
        if not self.has_value:
            return f"<{self.parameter}: {self.verdict}{label}>"
        values, stds = _columns(self.values, self.stds)
        text = f"{self.parameter} = {_join_numbers(values)} ± {_join_numbers(stds)}{_suffix(self.unit)}"
        if len(self.values) == 1:
            ends = f"95 % [{', '.join(self._ends(0))}]"
            limit = self.limit_in_words(0)
            text += f", {limit} (95 %)" if limit else f", {ends}"
        return f"<{text}, {self.verdict_in_words}{label}>"

    def cells(self) -> tuple[str, str, str, str]:
        """Cells of a table row with `COLUMNS`: parameter, value ± std, 95 % interval, verdict."""
        name, label = str(self.parameter), ", simulated" * self.simulated
        if not self.has_value:
            return name, "", "", self.verdict + label
        values, stds = _columns(self.values, self.stds)
        bounds = [self.limit_in_words(i) or " … ".join(self._ends(i)) for i in range(len(values))]
        number = f"{_join_numbers(values)} ± {_join_numbers(stds)}{_suffix(self.unit)}"
        return name, number, ", ".join(bounds), self.verdict_in_words + label

    def _repr_html_(self) -> str:
        """Small table for notebooks, one row per component."""
        heading = f"{escape(str(self.parameter))}: {self.verdict_in_words}"
        if self.contradiction:
            heading += f". {escape(self.contradiction)}"
        if not self.has_value:
            return f"<p>{heading}. {escape(self.method)}</p>"
        rows: list[str] = []
        # One row a component; a one-sided limit replaces the interval at a bound.
        for i, (value, std) in enumerate(zip(*_columns(self.values, self.stds), strict=True)):
            interval = self.limit_in_words(i) or " … ".join(self._ends(i))
            rows.append(f"<tr><td>{value}</td><td>± {std}</td><td>{interval}</td></tr>")
        columns = f"<tr><th>value{_suffix(escape(self.unit))}</th><th>std</th><th>95 %</th></tr>"
        return f"<table><caption>{heading}</caption>{columns}{''.join(rows)}</table>"

    def limit_in_words(self, i: int) -> str:
        """Limit (one-sided, 95 %) of a component at a bound, as `at most 0.007`; empty where no bound acts."""
        bound, limit = self.at_bound[i], self.limits[i]
        if bound is None or limit is None:
            return ""
        # One digit more than the value has, as the limit is rounded to either side.
        return f"{bound.words} {round_to_std(limit, 0.1 * float(self.stds[i]))[0]}"

    def _ends(self, i: int) -> list[str]:
        """Ends of a component's interval, with the digits of its value."""
        return [round_to_std(bound, float(self.stds[i]))[0] for bound in self.intervals[i].tolist()]


class Estimates(ByParameter[Estimate]):
    """Estimates by parameter."""

    __slots__ = ()
    estimates: tuple[Estimate, ...]

    def _entries(self) -> dict[Parameter, Estimate]:
        return {estimate.parameter: estimate for estimate in self.estimates}

    def to_dataframe(self) -> DataFrame:
        """Convert to a pandas data frame, one row per parameter.

        For a vector, `value` and `std` are (n,), and `ci95` is (n, 2). Raises Unavailable: pandas is not installed.
        """
        columns = ("value", "std", "unit", "ci95", "verdict", "method")
        found: dict[str, list[Any]] = {
            "object": [parameter.object for parameter in self],
            "quantity": [parameter.quantity for parameter in self],
        }
        for name in columns:
            found[name] = [getattr(estimate, name) for estimate in self.estimates]
        return data_frame(found)


def _of_scalar(numbers: Array) -> float | Array:
    """Scalar if there is exactly one number, NaN if there is none, else all of them."""
    if not len(numbers):
        return math.nan
    return float(numbers[0]) if len(numbers) == 1 else numbers


def not_identified(
    parameter: Parameter, unit: str, method: str, evidence: tuple[Recording, ...] = ()
) -> Estimate:
    """Estimate without a value, with the reason in words."""
    nothing = np.empty(0)
    return Estimate(parameter, unit, nothing, nothing, nothing, method, evidence, "not identified")


def not_measured(parameter: Parameter, unit: str) -> Estimate:
    """Estimate of a parameter whose conversion was not run."""
    quantity, name = parameter.quantity, parameter.object
    return not_identified(
        parameter, unit, f"The run ended before the {quantity} of {name} was measured."
    )


def interval95(value: ArrayLike, std: ArrayLike, freedom: float = math.inf) -> Array:
    """Central 95 % intervals (n, 2) of Student's t distribution, by default of the normal one."""
    middle = np.atleast_1d(np.asarray(value, dtype=np.float64))
    half = half95(freedom) * np.atleast_1d(np.asarray(std, dtype=np.float64))
    return np.column_stack([middle - half, middle + half])


def round_to_std(value: float, std: float) -> tuple[str, str]:
    """Round a value and its standard deviation to one digit of the latter, or two if it begins with 1 or 2."""
    if not (math.isfinite(value) and math.isfinite(std) and std > 0):
        return f"{value:.6g}", f"{std:.2g}"
    exponent = math.floor(math.log10(std))
    digits = 1 if std < 3 * 10**exponent else 0
    decimals = min(max(digits - exponent, 0), 9)
    return f"{value:.{decimals}f}", f"{std:.{decimals}f}"


def _columns(values: Array, stds: Array) -> tuple[list[str], list[str]]:
    """Values and standard deviations as text, each component with its own number of digits."""
    texts = [round_to_std(v, s) for v, s in zip(values.tolist(), stds.tolist(), strict=True)]
    return [value for value, _ in texts], [std for _, std in texts]


def _join_numbers(numbers: list[str]) -> str:
    return numbers[0] if len(numbers) == 1 else f"({', '.join(numbers)})"


def _suffix(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"
