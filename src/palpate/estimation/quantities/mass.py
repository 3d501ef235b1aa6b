"""Mass of a held object."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np

from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate, FitView, constant, not_measured, unit_slopes
from palpate.estimation.load_equations import FORCE_Z
from palpate.estimation.quantities.quantity import (
    Effort,
    Evidence,
    Prior,
    Quantity,
    Site,
    Status,
    Values,
)
from palpate.estimation.segments import PASS_SPEED, Segment, has_reference, weighing
from palpate.estimation.weighing import Lift, single_shot, weigh
from palpate.estimation.wrench_observation import observation_of_torques
from palpate.mjcf.body import Body, BodyDescription
from palpate.mjcf.contacts import find_constraint
from palpate.mjcf.edits import Slot
from palpate.mjcf.elements import Elements
from palpate.mjcf.inertial import Statement, mass_beside, mass_is_open, mass_of, unweighed_geoms
from palpate.robots.pace import configuration
from palpate.trace.samples import FORCES, Trace

UNIT = "kg"
PRIOR_DENSITY = 500.0
"""kg/m³. Prior density, between hollow household objects and wood."""
PRIOR_MASS = (0.02, 1.5)
"""kg. Bounds of the prior, from a plastic cup to a full bottle."""
PRIOR_FACTOR = 2.0
"""Largest ratio of a hidden mass to the prior; the prior's 1 sigma is half of it."""
SAMPLING = 1000.0
"""1/s. Sampling rate of joint torques; each sample has the noise of the arm's description."""
SLOWEST = 1.5 * PASS_SPEED
"""m/s. Slowest speed of a pass at which joints still slide all the way."""
SPEEDS = 8
"""Number of speeds of a pass that are compared."""
ROUND = 8.0
"""s. Duration of a further round without its passes: from home to the object, and back."""
MOST_CYCLES = 4
"""Largest number of cycles in one tree; a further round reduces the remaining noise."""
WHOLE = (
    " Mean with a fit to 15 s of motion in free air before and after it, weighted by the variances: noise alone "
    "accounts for the residuals of a model of the arm's links, sensors and friction there."
)
SENSED = " The fit has the readings of the force/torque sensor at the wrist, too."


class Mass(Quantity):
    """Mass of an object."""

    id = "mass"
    unit = UNIT
    subject = "object"
    bounds = (0.0, np.inf)
    words: ClassVar = {
        "en": ("mass", "weight", "heavy", "weigh", "heaviness"),
        "de": ("masse", "massen", "gewicht", "gewichte"),
        "es": ("masa", "masas", "peso", "pesos"),
        "fr": ("masse", "masses", "poids"),
        "it": ("massa", "masse", "peso", "pesi"),
    }
    evidence = (
        Evidence(
            FORCES,
            "lift the object clear of its support, MeasureForces while still",
            activity=("still",),
            holding=True,
        ),
    )
    estimators: ClassVar = {
        "contrast": "palpate.estimation.quantities.mass:estimate_mass",
        "rests-and-passes": "palpate.estimation.quantities.mass:estimate_by_rests_and_passes",
        "single-shot": "palpate.estimation.quantities.mass:estimate_single_shot",
        "recording": "palpate.estimation.carried:estimate_mass",
    }

    def status(self, body: BodyDescription) -> Status:
        return "missing" if mass_is_open(body) else "known"

    def compiled(self, body: BodyDescription) -> tuple[float, ...]:
        return (mass_of(body),)

    def overruled(self, body: BodyDescription) -> str:
        return find_constraint(body)

    def slots(self, elements: Elements) -> Iterator[Slot]:
        for geom in elements.geoms:
            yield Slot(geom, "mass", "1")
            yield Slot(geom, "density", "1000")
        if elements.inertial is not None:
            yield Slot(elements.inertial, "mass", "1", required=1)

    def prior(self, body: BodyDescription, believed: Values) -> Prior:
        """Prior from the volume of the geoms without a mass, plus the masses that the file states."""
        geoms = unweighed_geoms(body)
        # If all open geoms are visual only, take the volume of the colliding ones.
        solid = [geom for geom in body.elements.colliding if geom in geoms]
        volume = sum(body.shapes.volume(geom) for geom in solid or body.elements.colliding)
        mass = float(np.clip(volume * PRIOR_DENSITY, *PRIOR_MASS))
        return Prior((mass_beside(body) + mass,), (0.5 * mass,))

    def draw(self, body: Body, prior: Prior, random: np.random.Generator) -> tuple[float, ...]:
        """Draw log-uniformly within `PRIOR_FACTOR` of the prior, plus the mass that the file states."""
        factor = PRIOR_FACTOR ** random.uniform(-1, 1)
        unknown = 2.0 * prior.std[0]
        stated = prior.mean[0] - unknown
        return (stated + float(np.clip(unknown * factor, *PRIOR_MASS)),)

    def floor(self, site: Site) -> float:
        """Uncertainty from the gains of the joint torque sensors, kg."""
        gravity, arm = site.gravity, site.arm
        weight, lift = site.believed[0] * gravity, predicted_lift(site, None)
        return lift.floor(1, arm.pace.speed, weight, gravity, arm.nominal) / gravity

    def effort(self, site: Site, std: float, trace: Trace | None) -> Effort:
        """Cycles of an empty and a loaded pass each way that suffice in the least time.

        Slow passes average white noise; more cycles average slower noise.
        """
        lift, gravity, hand = predicted_lift(site, trace), site.gravity, site.arm.nominal
        weight = site.believed[0] * gravity
        # Search speeds, and the fewest cycles that suffice at each.
        least, best = np.inf, Effort()
        for speed in np.geomspace(SLOWEST, site.arm.pace.speed, SPEEDS).round(3).tolist():
            for cycles in range(1, MOST_CYCLES + 1):
                left = lift.noise(cycles, speed, weight, gravity, hand) / gravity
                enough, takes = left <= std, cycles * lift.seconds(speed)
                # Variance falls with the number of rounds, and each round costs its overhead.
                cost = takes if enough else takes * (left / std) ** 2 + ROUND
                if cost < least:
                    least, best = cost, Effort(cycles, speed)
                if enough or takes + lift.seconds(speed) > least:
                    break
        return best

    def write(
        self, body: BodyDescription, value: tuple[float, ...], std: float | None
    ) -> Iterator[Statement]:
        """Write into `<inertial>` if there is one, else into the geoms without a mass."""
        yield Statement(mass=value[0], std=std)


def predicted_lift(site: Site, trace: Trace | None) -> Lift:
    """Predict the lift at a site, with the signal noise of the arm's description or of a trace."""
    arm, base = site.arm, site.pose_world_base
    assert arm.nominal.chain is not None
    # Joint angles at the grasp and at the end of the lift, in the arm's base.
    poses = [base.inverse() @ pose for pose in (site.grasp, site.above)]
    q = np.array([configuration(arm, pose) for pose in poses])
    observed = observation_of_torques(
        np.zeros((0, len(arm.joints))), arm.nominal.chain, base.rotation
    )
    # Power spectral density of white noise: variance over sampling rate.
    white, flicker = arm.sensors.torque_noise**2 / SAMPLING, np.zeros(len(arm.joints))
    recording = trace.converted(site.parameter) if trace is not None else None
    if trace is not None and recording is not None:
        noise = weighing(trace, recording).noise
        # A trace of the same measurement replaces the noise of the description.
        white, flicker = noise.white * float(np.median(np.diff(trace.t))), noise.flicker
    length = site.grasp.distance_to(site.above)
    return Lift(q, length, site.near_speed, arm.pace.acceleration, observed, white, flicker)


def estimate_mass(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Vertical force of the load over g, in contrast to the same rests and passes without the object.

    `parts` holds the mean of F_z/g of the recording alone as `single-shot`.
    Raises ValueError: the recording holds no samples or no held object.
    """
    return _contrast(trace, parameter, by_all_motion=True)


def estimate_by_rests_and_passes(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Mass from rests and passes alone, without the other motion in free air.

    It also omits the residual of the arm model (standard deviations 0 to 10 % smaller by that alone). It is less
    precise than `estimate_mass` and takes a sixth of the time.
    """
    return _contrast(trace, parameter, by_all_motion=False)


def _contrast(trace: Trace, parameter: Parameter, by_all_motion: bool) -> Estimate:
    recording = trace.converted(parameter)
    if recording is None:
        return not_measured(parameter, UNIT)
    # Contrast of loaded and empty segments; the paper's estimate is a further result.
    weight = weigh(trace, recording, by_all_motion)
    method = contrast_method([one for found in weight.weighings for one in found.segments])
    if weight.whole is not None:
        method += WHOLE + SENSED * weight.whole.has_sensor
    return Estimate.normal(
        parameter,
        UNIT,
        weight.mass,
        weight.std,
        method,
        evidence=(recording,),
        parts={"single-shot": single_shot(trace, recording)},
        tests=weight.load.tests,
        shared=weight.shared,
        freedom=weight.best.freedom,
        views=(weight.view(),),
        reason=weight.doubt,
    )


def estimate_single_shot(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """Mean of F_z / g while the object is held at rest, the paper's Force2Mass.

    There is no contrast with the empty hand. The value contains the arm's bias, and the standard deviation contains
    the bias seen with the empty hand.
    """
    recording = trace.converted(parameter)
    if recording is None:
        return not_measured(parameter, UNIT)
    # Mean over the recording, with the wrench over time as chart.
    mean = single_shot(trace, recording)
    method = (
        "Mean vertical force while held still, over g; not compared with the empty hand, so the "
        "arm's own bias is only bounded, by the forces of the empty hand."
    )
    samples = trace.of(recording)
    view = FitView(
        name="Vertical force over g.",
        note="Its mean over the recording is the mass.",
        axes=("robot time (s)", "F_z / g (kg)"),
        x=samples.t,
        measured=samples.wrench[:, FORCE_Z] / trace.gravity,
        predicted=constant(mean.value, samples.t),
        slopes=unit_slopes(samples.t),
    )
    return Estimate.normal(
        parameter, UNIT, mean.value, mean.std, method, (recording,), views=(view,)
    )


def contrast_method(found: Sequence[Segment]) -> str:
    """Describe the contrast: the numbers of rests and passes, loaded and empty."""
    if not has_reference(found):
        return (
            "Mean vertical force while held still, over g; no unloaded pass or rest at the same pose was "
            "recorded, so the arm's own bias is only bounded by its datasheet."
        )
    # Count rests and passes, loaded and empty.
    count = Counter((segment.at_rest, segment.loaded) for segment in found)
    return (
        f"mass = (F_z loaded − F_z empty) / g: {count[True, True]} loaded against "
        f"{count[True, False]} empty rests and {count[False, True]} loaded against {count[False, False]} "
        "empty passes over the same path in the same direction, fitted in the arm's joints."
    )
