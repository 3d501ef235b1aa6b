"""Range of a fixture's joint, from the rise of the force at its limits."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from palpate.common.parameter import Parameter
from palpate.common.pose import Array, Joint
from palpate.estimation.estimate import Estimate, FitView, not_identified
from palpate.estimation.motion import mean_pose, smooth_rows
from palpate.estimation.quantities.fixture_dynamics import LEVER
from palpate.estimation.quantities.quantity import Evidence, Prior, Quantity, Status, Values
from palpate.estimation.touch import REACH
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.document import UNKNOWN, compiler_settings, tokens
from palpate.mjcf.edits import Edit, Slot, number
from palpate.mjcf.elements import Elements
from palpate.trace.recording import Recording
from palpate.trace.samples import FORCES, Trace

LIMIT_SMOOTH = 5
"""Rows (25 ms) over which the force at a limit is averaged. Sensitive: not tried."""
LIMIT_PRESSED = 15.0
"""N. Smallest force that shows a limit. Sensitive: no, limits are pressed with 30 N."""
LIMIT_BEFORE = 2.0
"""s. Window before the largest force that is searched for the force of free motion. Sensitive: not tried."""
LIMIT_NEAR = 0.008
"""m before the farthest point within which motion is no longer free: a stop and an arm deform by some millimetres.
Sensitive: not tried."""
LIMIT_SHARE = 0.2
"""Fraction of the rise of the force above which it counts as rising: pads and rails deform before. Sensitive: not
tried; a lower one takes noise for the foot of the curve."""
LIMIT_ALIKE = 10.0
"""Number of neighbouring rows of a loading curve with the same error. Sensitive: the deviation of a limit by noise is
proportional to its root."""
LIMIT_FOOT = 2e-4
"""m (1 sigma). Deformation of pads and rails before a limit carries load; in the simulation 0.1 to 0.2 mm. Sensitive:
at `lab` it is most of a limit's deviation."""
LIMIT_SCALE = 0.8
"""Fraction (1 sigma) of the angle error of an arm by which its path to a limit is too long or short. At `measured`, it
is 0.6 mm of 0.22 m (root mean square of seven arms). Sensitive: limit std ×1.0–2.5 at `measured`, not at `lab`."""
LIMIT_SOFT = 0.05
"""Fraction (1 sigma) of the deflection at a limit by which the loading curve of a stop may deviate from a line.
Sensitive: not tried."""
LIMIT_ALL = 0.95
"""Fraction of the largest force at which the loading of a limit ends. Sensitive: not tried."""

SETTING_OUT = 20  # rows, 0.1 s, at the start of a recording, in which the hand rests


@dataclass(frozen=True, slots=True, eq=False)
class Limit:
    """Limit of a joint that the handle was pressed against."""

    sign: float  # 1 for the upper limit, -1 for the lower
    # travel, std: m or rad, from the start of the recording
    travel: float
    std: float
    way: Array  # (n,) m, travel of the handle towards the limit in the rows of the loading curve
    force: Array  # (n,) N, of the hand against it
    predicted: Array  # (n,) N, by the fit


def limits_of(trace: Trace, recording: Recording, joint: Joint) -> Iterator[Limit]:
    """Yield the limits that the handle met in a recording, the upper one first."""
    samples = trace.of(recording)
    if len(samples) <= SETTING_OUT:
        return
    # Travel of the handle, and the force of the hand along it beyond that at rest.
    start = mean_pose(samples.where(slice(0, SETTING_OUT)))
    positions = samples.pose_world_tcp[:, :3]
    lever = joint.lever(start.position)
    way = lever * joint.travels(start, positions)
    along = np.einsum("ni,ni->n", joint.along(positions), samples.wrench) / lever
    force = smooth_rows(along - along[:SETTING_OUT].mean(), LIMIT_SMOOTH)
    for sign in (1.0, -1.0):
        pressed = sign * force
        if pressed.max() < LIMIT_PRESSED:
            continue
        # Use the rows up to the peak: the hand then rests against the limit.
        peak = int(np.argmax(pressed > LIMIT_ALL * pressed.max()))
        found = _loading(samples.t[: peak + 1], sign * way[: peak + 1], pressed[: peak + 1])
        if found is not None:
            where, std, rows, predicted = found
            # An uncalibrated arm has an angle error, and measures a path too long or too short.
            scale = LIMIT_SCALE * trace.hand.tip_offset_std / REACH
            parts = (std, trace.hand.pose_repeatability, LIMIT_FOOT, scale * where)
            std = float(np.linalg.norm(parts))
            shown = sign * way[rows], pressed[rows], predicted
            yield Limit(sign, sign * where / lever, std / lever, *shown)


def _loading(t: Array, way: Array, force: Array) -> tuple[float, float, slice, Array] | None:
    """Fit a loading curve: a constant force up to the limit, then a linear rise.

    Returns the travel, m, at which the force begins to rise, its standard deviation, the rows of the curve, and the
    fitted force (n,). Returns None where the force does not rise steeply.
    """
    first = int(np.searchsorted(t, float(t[-1]) - LIMIT_BEFORE))
    rows = slice(first, len(t))
    x, f = way[rows], force[rows]
    # Force of free motion: the median before the rise, which comes at the end.
    early = x < x[-1] - LIMIT_NEAR
    if early.sum() < SETTING_OUT:
        return None
    moving = float(np.median(f[early]))
    rising = f > moving + LIMIT_SHARE * (f[-1] - moving)
    rising &= np.arange(len(f)) > int(np.flatnonzero(early)[-1])
    if rising.sum() < 5:
        return None
    # Line through the rise: its intercept is the travel at the force of free motion.
    slope, middle = np.polyfit(f[rising] - moving, x[rising], 1)
    left = x[rising] - middle - slope * (f[rising] - moving)
    # The error at the foot of the line includes its leverage; correlated rows count as few.
    independent = max(rising.sum() / LIMIT_ALIKE, 2.0)
    spread = float(np.std(f[rising])) or 1.0
    lever = float(np.mean(f[rising]) - moving) / spread
    unsteady = float(np.std(f[early])) * abs(slope)
    std = float(np.hypot(np.std(left) * np.sqrt((1.0 + lever**2) / independent), unsteady))
    predicted = moving + np.maximum(x - middle, 0.0) / max(abs(slope), 1e-9)
    return float(middle), std + LIMIT_SOFT * abs(x[-1] - middle), rows, predicted


# Range of the joint of a drawer, a door or a window: its lower and upper limit


BELIEVED = (0.2, 0.1)
"""m at the handle. Prior mean and standard deviation of the travel from the present position to an open limit."""
DRAWN = (0.08, 0.25)
"""m at the handle. Range of the drawn travel to an open upper limit; the lower limit of a closed fixture is near."""
CLOSED = (0.0, 0.03)
"""m at the handle. Range of the drawn travel to an open lower limit."""


class Range(Quantity):
    """Lower and upper limit of a joint: `range` in MuJoCo, m or rad."""

    id = "range"
    unit = "m"
    subject = "fixture"
    how = "FindLimits with MeasureForces"
    size = 2
    words: ClassVar = {
        "en": ("range of motion", "joint limits", "joint range", "opening range"),
        "de": ("bewegungsbereich", "öffnungsweg", "öffnungswinkel"),
        "es": ("recorrido de apertura",),
        "fr": ("course d'ouverture",),
        "it": ("corsa di apertura",),
    }
    evidence = (
        Evidence(
            FORCES, "in a Parallel with FindLimits at its handle", activity=("limit",), holding=True
        ),
    )
    derived = True
    estimators: ClassVar = {"stops": "palpate.estimation.quantities.fixture_range:estimate_range"}

    def status(self, body: BodyDescription) -> Status:
        joint = body.joint
        if joint is None:
            return "not applicable"
        if any(joint.open):
            return "missing"
        return "known" if np.isfinite(joint.low) else "not applicable"

    def compiled(self, body: BodyDescription) -> tuple[float, ...] | None:
        joint = body.joint
        return None if joint is None or not np.isfinite(joint.low) else (joint.low, joint.high)

    def slots(self, elements: Elements) -> Iterator[Slot]:
        if elements.joint is not None:
            # Wide placeholders, so that the scene compiles with either limit known.
            yield Slot(elements.joint, "range", "-3", numbers=(0,))
            yield Slot(elements.joint, "range", "3", numbers=(1,))

    def prior(self, body: BodyDescription, believed: Values) -> Prior:
        joint = body.joint
        assert joint is not None
        # Open limits lie symmetrically about the present position; stated ones are exact.
        scale = 1.0 if joint.is_slide else 1.0 / LEVER
        mean, std = scale * BELIEVED[0], scale * BELIEVED[1]
        low, high = joint.open
        return Prior(
            (
                joint.position - mean if low else joint.low,
                joint.position + mean if high else joint.high,
            ),
            (std if low else 0.0, std if high else 0.0),
        )

    def draw(self, body: Body, prior: Prior, random: np.random.Generator) -> tuple[float, ...]:
        joint = body.joint
        assert joint is not None
        # Draw the open limits about the present position.
        scale = 1.0 if joint.is_slide else 1.0 / LEVER
        low, high = prior.mean
        if prior.std[0]:
            low = joint.position - scale * float(random.uniform(*CLOSED))
        if prior.std[1]:
            high = joint.position + scale * float(random.uniform(*DRAWN))
        return low, high

    def write(
        self, body: BodyDescription, value: tuple[float, ...], std: float | None
    ) -> Iterator[Edit]:
        joint, element = body.joint, body.elements.joint
        assert joint is not None
        assert element is not None
        # The file may state angles in degrees; stated limits stay as written.
        settings = compiler_settings(element.getroottree().getroot())
        degrees = not joint.is_slide and settings.get("angle", "degree") == "degree"
        parts = tokens(body.defaults.attribute(element, "range") or "? ?")
        numbers = {
            side: number(np.degrees(limit) if degrees else limit)
            for side, limit in enumerate(value)
            if parts[side] == UNKNOWN or not any(joint.open)
        }
        yield Edit(element, "range", numbers, "? ?")


def estimate_range(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Limits of a joint, from the travel at which the force at its handle begins to rise."""
    joint = None if body is None else body.joint
    recordings = [
        recording
        for recording in trace.recordings
        if recording.context.activity == "limit" and recording.context.holding == parameter.object
    ]
    if joint is None or not recordings:
        reason = f"No recording shows '{parameter.object}' moved to its limits."
        return not_identified(parameter, "m", reason)
    # Collect the limits by side over all recordings.
    met: dict[float, list[Limit]] = {1.0: [], -1.0: []}
    for recording in recordings:
        for limit in limits_of(trace, recording, joint):
            met[limit.sign].append(limit)
    # Estimate each open side; a stated side is exact.
    sides = ((-1.0, joint.low, joint.open[0]), (1.0, joint.high, joint.open[1]))
    anything = any(joint.open)
    values: list[float] = []
    stds: list[float] = []
    for sign, stated, is_open in sides:
        if anything and not is_open:
            values, stds = [*values, stated], [*stds, 0.0]
            continue
        if not met[sign]:
            reason = f"'{parameter.object}' met no {'upper' if sign > 0 else 'lower'} limit."
            return not_identified(parameter, joint.unit(), reason, tuple(recordings))
        # Weighted mean of all contacts with this limit.
        weights = np.array([limit.std for limit in met[sign]]) ** -2.0
        travels = np.array([limit.travel for limit in met[sign]])
        values.append(joint.position + float(np.average(travels, weights=weights)))
        stds.append(float(weights.sum() ** -0.5))
    return Estimate.normal(
        parameter,
        joint.unit(),
        values,
        stds,
        "Where the force along the joint begins to rise as its handle is moved against its limits.",
        tuple(recordings),
        views=tuple(_view(limit) for limits in met.values() for limit in limits),
    )


def _view(limit: Limit) -> FitView:
    return FitView(
        name=f"{'Upper' if limit.sign > 0 else 'Lower'} limit.",
        note="Up to the limit the force is that of moving; beyond it stop, hand and arm give way.",
        axes=("way towards it (mm)", "force (N)"),
        x=1e3 * limit.way,
        measured=limit.force,
        predicted=limit.predicted,
        groups="pressed",
    )
