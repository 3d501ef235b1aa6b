"""Touch of a surface by a guarded descent; several touches as one height or plane."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.common.pose import Array
from palpate.estimation.descent import (
    BLOCK_ROWS,
    FREE_SLOPE,
    LATE_FORCE,
    SOFT,
    SOFT_FORCE,
    SUSTAINED,
    UNSEEN,
    Descent,
    at_most,
    contact_height_if_rigid,
    descent_before,
    first_contact,
    knee,
    leans,
    running_median,
)
from palpate.estimation.estimate import FitTest, FitView
from palpate.estimation.motion import mean_pose
from palpate.estimation.spring import Onset, Spring, fit_spring
from palpate.estimation.wrench_observation import TORQUE_LEVER
from palpate.trace.recording import NominalHand, Recording
from palpate.trace.samples import Trace

APART = 0.05
"""m: minimum distance between three touches that determine the tilt of a surface. An error of 0.1
mm between two touches is then 2 mrad. Not sensitive."""


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """Plane through the touches of a surface."""

    height: float  # m, at the mean position of the touches
    std: float  # m, without the errors that all touches share
    # rad, angle from level, and its standard deviation; None where the touches do not span a plane.
    tilt: tuple[float, float] | None
    misfit: float  # sum of the squared residuals over their variances
    freedom: int  # residual degrees of freedom
    slope: Array | None  # (2,) rise along x and along y; None where the touches do not span a plane
    slope_std: Array | None  # (2,) its standard deviations; None with `slope`
    beside: Array  # (n, 2) m, positions of the touches from their mean
    heights: Array  # (n,) m, of the touches
    stds: Array  # (n,) m, standard deviations of the heights

    @property
    def fitted(self) -> Array:
        """(n,) m, height of the plane at each touch."""
        rise = 0.0 if self.slope is None else self.beside @ self.slope
        return np.full(len(self.heights), self.height) + rise

    def view(self, of_tilt: bool) -> FitView:
        """Chart the touches and the plane, seen from the side along the steepest direction.

        Args:
            of_tilt: the chart belongs to an estimate of the tilt, else of the height.
        """
        # Without a slope, the chart is along world x.
        slope = np.array([1.0, 0.0]) if self.slope is None else self.slope
        uphill = slope / max(float(np.linalg.norm(slope)), 1e-12)
        heading = float(np.degrees(np.arctan2(uphill[1], uphill[0])))
        # Text of the direction in which the plane rises.
        rises = (
            "is level" if self.slope is None else f"rises most towards {heading:.0f}° from world x"
        )
        return FitView(
            name=f"The {len(self.heights)} touches, from the side.",
            note=f"Height of each touch and the fitted plane, which {rises}.",
            axes=("along the way uphill (mm)", f"height above {self.height:.4f} m (mm)"),
            x=1e3 * self.beside @ uphill,
            measured=1e3 * (self.heights - self.height),
            predicted=1e3 * (self.fitted - self.height),
            std=1e3 * self.stds,
            groups="a touch",
            slopes=1e3 * (self.beside if of_tilt else np.ones((len(self.heights), 1))),
        )


def fit_plane(spots: Array, heights: Sequence[float], stds: Sequence[float]) -> Plane:
    """Fit a plane by weighted least squares to touches at `spots` (n, 2), m.

    Where the touches do not span a plane, fit their weighted mean height.
    """
    # Design: height at the mean position, and the two slopes where they are observable.
    z, weight = np.asarray(heights), 1.0 / np.asarray(stds)
    middle = spots.mean(axis=0)
    level = np.ones((len(z), 1))
    leaning = np.hstack([level, spots - middle])
    design = leaning if spans_plane(spots) else level
    # Solve the normal equations with weights 1/std.
    weighted = design * weight[:, None]
    covariance = np.linalg.inv(weighted.T @ weighted).astype(np.float64)
    solution: Array = covariance @ weighted.T @ (z * weight)
    misfit = float(np.sum(((z - design @ solution) * weight) ** 2))
    variance, tilt = float(covariance[0, 0]), None
    slope: Array | None = None
    slope_std: Array | None = None
    if design.shape[1] == 3:
        slope, slope_std = solution[1:], np.sqrt(np.diag(covariance)[1:])
        tilt = (float(np.linalg.norm(slope)), float(np.sqrt(np.mean(slope_std**2))))
        # A tilted surface has no single height. Add the mean square of its rise among the touches.
        rise: Array = (spots - middle) @ slope
        variance += float(np.mean(rise**2))
    freedom = len(z) - len(solution)
    height, std = float(solution[0]), float(np.sqrt(variance))
    touches = spots - middle, z, np.asarray(stds)
    return Plane(height, std, tilt, misfit, freedom, slope, slope_std, *touches)


def spans_plane(spots: Array) -> bool:
    """Return true if three spots are at least `APART` from one another and not collinear."""
    if len(spots) < 3:
        return False
    # Spread along the shorter principal axis. An equilateral triangle with sides APART has APART /
    # sqrt(6); half of that is still not collinear.
    centred = spots - spots.mean(axis=0)
    variances = np.linalg.eigvalsh(centred.T @ centred / len(spots)).astype(np.float64)
    return float(variances[0]) >= (APART / 2) ** 2 / 6


# Tuning constants of a touch.


LATER_FORCE = 0.66
"""fraction of the greatest force, as `LATE_FORCE`, below a soft layer, which may carry as much
force itself. Sensitive for cloths of some 400 N/m and layered foams."""
LAST_RISE = 6.0
"""N: largest force rise of the last stretch below a soft layer. A press goes on for 8 N after a rigid surface stops the
tips (`vocabulary.contact`). Sensitive for cloths that carry more than 12 N."""
LEAST_RISE = 1.5
"""N: smallest force rise of the last stretch from which its slope is used. Not sensitive."""
STIFF = 2e-5
"""m/N: a contact below this compliance is stiff, and its penetration correction small. A steel or
stone table has 1 to 10 µm/N. Not sensitive."""
RIGID = 6e-5
"""m/N: largest compliance of a rigid surface. A light table has up to 40 µm/N: 18 mm chipboard, 0.6
m wide, 1.2 m long, supported at its ends, 48 E I / L³ with E = 3 GPa. Hard pads and the joints
behind the encoders add some 20. Not sensitive."""
SURE = 1.0
"""standard deviations between the compliance and `RIGID` for a surface that counts as rigid. With
uncalibrated tips (15 µm/N), a table of 20 µm/N is accepted with a margin of 1.6 standard
deviations, and a mat of 80 µm/N rejected with 2.3. Not sensitive with known tips."""
SOLID = 0.05
"""fraction (1 sigma) of the thickness of a soft layer that remains under any pressure. It is the
relative density of flexible foams, 0.02 to 0.1 (Gibson & Ashby, Cellular Solids). Sensitive only
where a soft layer was pressed through: height std ×0.6–1.9."""
CORRECTION = 0.25
"""fraction (1 sigma) of the penetration correction: contacts are not exactly linear. Hardly sensitive."""
YIELDING = 0.5
"""fraction (1 sigma) of the penetration correction where the surface is not stiff. Sensitive only
there: height std ×0.6–1.9."""
LEANS_OVER = 3.3e-3
"""rad: lean of the hand at a contact that shows that one finger alone is in contact. An uncalibrated arm has an error
of 1.2 mrad (1 sigma) against a level surface: 1 mrad in each joint that tilts the hand, and 0.5 mrad in the level of
the base. 30 N on one finger cause a lean of 4.2 mrad at 280 N m/rad. Not sensitive."""
TURNING_STIFFNESS = 280.0
"""N m/rad of the controller, about a horizontal axis: least lean of the hand by a moment. Hardly sensitive."""
REACH = 0.5
"""m: typical distance of a touch from the base. It converts an angle error into a height error. A
larger stated error of the fingertips allows a larger lean accordingly. Not sensitive."""
VIEW_ABOVE = 0.006
"""m: smallest height of free air in a chart of a touch. Not sensitive."""


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceTouch:
    """Contact at the end of a guarded descent."""

    recording: Recording  # of the held pose
    descent: Descent  # the guarded descent before it
    spot: Array  # (2,) m, world x and y of the fingertips
    # m, tip height at the force `full`. It is that of the recording. After a press through a soft
    # layer it is the height before the press was eased, as the tip may rise into the layer again.
    held: float
    full: float  # N, pressing force at rest
    rise: float  # N, force rise of the last stretch of the loading curve
    rise_std: float  # N, its standard deviation by joint friction
    compliance: float  # m/N, of the last stretch
    knee: float  # N, force at the beginning of that stretch; 0 where it begins in free air
    # m, height of the rigid surface below a soft layer; None without a layer.
    bottomed: float | None
    first: float  # m, tip height at which the force began to rise
    first_std: float  # m, its standard deviation
    # m along the closing direction, from the middle of the fingers to the line of the force.
    lever: float
    lever_std: float  # m, its standard deviation
    lean: float  # rad, largest lean of the hand in that direction caused by the contact
    opening: float  # m, between the fingers
    own: float  # m/N, compliance of the tips themselves
    own_std: float  # m/N, its standard deviation
    out_of_level: float  # rad, uncertainty of the angle between the arm's base and a level surface
    level_std: float  # rad (1 sigma), angle of the hand against a level surface
    spring: Spring  # the surface as a spring above a rigid support

    @property
    def height(self) -> float:
        """m, of a rigid surface extrapolated to zero force; of a compliant one, of the first contact."""
        return self.first if self.gives_way else self.held + self.penetration

    def height_std(self, hand: NominalHand) -> float:
        """Compute the standard deviation, m, of the height of one touch.

        The error of the tip length is left out, as all touches share it.
        """
        # Uncertainty of the penetration correction: smaller for stiff contacts.
        compliance = self.penetration / self.full
        stiff = compliance <= STIFF
        correction = CORRECTION if stiff else YIELDING
        parts = (
            hand.pose_repeatability,
            UNSEEN,
            correction * self.penetration,
            compliance * hand.force_repeatability,
            SOLID * self.soft,
            self.first_std if self.gives_way else 0.0,
        )
        return float(np.linalg.norm(parts))

    @property
    def penetration(self) -> float:
        """m, depth of the held tip below the surface."""
        whole = max(self.first - self.held, 0.0)
        if self.gives_way:
            return whole
        # Use the last stretch where it leads back to the first contact. An oscillation of the arm
        # disturbs it; the whole curve counts then.
        stretch = self.compliance * max(self.full - self.knee, 0.0)
        if self.knee > 0.0 or abs(whole - stretch) < 2.0 * self.first_std:
            return stretch
        return whole

    @property
    def at_most(self) -> float:
        """m/N, upper bound of the surface's compliance at `SURE` standard deviations.

        It follows from the spring fit, or below a soft layer from the last stretch, less the tips' compliance.
        """
        if self.knee == 0.0:
            return self.spring.at_most(SURE)
        return self._compliance_bound(-SURE) - self.own + SURE * self.own_std

    @property
    def at_least(self) -> float:
        """m/N, lower bound of the surface's compliance at 2 standard deviations."""
        if self.knee == 0.0:
            return self.spring.at_least(2.0)
        return self._compliance_bound(2.0) - self.own - 2.0 * self.own_std

    def _compliance_bound(self, sigmas: float) -> float:
        """Compliance of the last stretch, m/N, for a force rise that is larger by `sigmas` standard deviations."""
        risen = max(self.rise + sigmas * self.rise_std, SOFT_FORCE)
        return self.compliance * self.rise / risen

    @property
    def pressed_through(self) -> bool:
        """True if a soft layer was met above the surface that stopped the tip."""
        return self.bottomed is not None or self.knee > 0.0

    @property
    def gives_way(self) -> bool:
        """True if the surface may exceed the compliance of a rigid one."""
        return self.at_most > RIGID

    @property
    def soft(self) -> float:
        """m, thickness of a soft layer that was pressed through; 0 without a layer."""
        thickness = self.first - self.height
        return thickness if thickness > SOFT and not self.gives_way else 0.0

    def firm(self) -> FitTest:
        """Test that the surface is rigid."""
        certain = self.at_least > RIGID
        how = "gives way" if certain else "may give way"
        return FitTest(
            "rigid",
            self.at_most,
            RIGID,
            f"It {how}: pressed with {self.full:.1f} N, the tip was held "
            f"{1e3 * self.penetration:.1f} mm below where it met it, and how far something rigid is "
            "below that is not known.",
        )

    def sides(self) -> Iterator[FitTest]:
        """Test that both fingers are in contact, by the lean of the hand and by the moment.

        With one finger alone, the force acts nearer to it than to the middle, and the hand leans to the other side.
        """
        lower = abs(self.lean) * self.opening
        yield FitTest(
            "both fingers stand",
            abs(self.lean),
            self.out_of_level,
            f"One finger alone stands on something: the hand leans over by {1e3 * abs(self.lean):.1f} "
            f"mrad, and the other finger, {1e3 * lower:.1f} mm lower for it, meets nothing.",
        )
        # The lever of the force is tested only where it is known to half of the distance that counts.
        nearer = self.opening / 4
        if 2.0 * self.lever_std >= nearer:
            return
        # A hand that is out of level stands on one finger until the moment has turned it by that angle.
        beside = abs(self.lever)
        turned = max(abs(self.lean), self.full * beside / TURNING_STIFFNESS)
        if beside * self.level_std >= nearer * turned:
            return
        finding = (
            f"One finger alone stands on something: the force acts {1e3 * beside:.0f} mm beside the "
            "middle of the hand, on a thing or a slope under that finger."
        )
        yield FitTest("both fingers", beside, nearer, finding)


def touches_of(trace: Trace, recordings: Iterable[Recording]) -> list[SurfaceTouch]:
    """Find the touches of the guarded descents before recorded poses; skip those without contact.

    Raises ValueError: see `find_touch`.
    """
    met = [find_touch(trace, recording) for recording in recordings]
    return [touch for touch in met if touch is not None]


def plane_of(touches: Sequence[SurfaceTouch], hand: NominalHand) -> Plane:
    """Fit the plane through touches of a surface."""
    spots = np.array([touch.spot for touch in touches])
    stds = [touch.height_std(hand) for touch in touches]
    return fit_plane(spots, [touch.height for touch in touches], stds)


def touch_views(
    touches: Sequence[SurfaceTouch], plane: Plane, slopes: Array | None = None
) -> tuple[FitView, ...]:
    """Chart the touches and the `plane` through them.

    Args:
        slopes: (p,) derivative of the height by each component of the estimate; by default the
            estimate is the height itself.
    """
    effect = np.ones(1) if slopes is None else slopes
    pairs = zip(touches, plane.fitted.tolist(), strict=True)
    curves = tuple(loading_curve_view(touch, height, effect) for touch, height in pairs)
    if len(touches) == 1 or slopes is not None:
        return curves
    return plane.view(of_tilt=False), *curves


def loading_curve_view(touch: SurfaceTouch, height: float, effect: Array) -> FitView:
    """Chart the loading curve of a touch, and its extrapolation to the surface at `height`, m."""
    descent, met = touch.descent, max(height, touch.first)
    # Show some free air above the contact.
    rows = descent.z <= met + max(VIEW_ABOVE, 0.4 * (met - float(descent.z.min())))
    # Fraction of the force rise above the knee, along which the fit is a straight line.
    force = descent.force[rows]
    bearing = np.maximum(force - touch.knee, 0.0) / max(touch.full - touch.knee, SOFT_FORCE)
    note = f"The tips were held at {1e3 * touch.held:.2f} mm, pressing with {touch.full:.1f} N"
    if touch.soft > 0.0:
        note += f"; something soft was met at {1e3 * touch.first:.1f} mm and pressed through"
    return FitView(
        name=f"The touch at {touch.recording.start:.1f} s.",
        note=f"{note}. The fit carries that back along the loading curve to where the force began: the height.",
        axes=("pressing force, less that of free air (N)", "height of the fingertips (mm)"),
        x=force,
        measured=1e3 * descent.z[rows],
        predicted=1e3 * (height - touch.penetration * bearing),
        used=np.flatnonzero(rows) > descent.onset,
        groups="the descent",
        slopes=1e3 * np.tile(effect, (len(force), 1)),
    )


def find_touch(trace: Trace, recording: Recording) -> SurfaceTouch | None:
    """Find the touch of the guarded descent before a recorded pose; None without a lasting contact force.

    Raises ValueError: the recording holds no samples, or no guarded descent comes before it.
    """
    descent = descent_before(trace, recording)
    if descent is None:
        return None
    samples = descent.samples
    # Last stretch of the loading curve: it begins at a fraction of the greatest force at rest.
    most, deepest = at_most(descent)
    level = LATE_FORCE * most
    late = descent.crossing(level)
    first, first_std = first_contact(descent, late)
    if first - float(descent.z[late]) > SOFT:
        # A soft layer may carry that force: begin later.
        level = max(LATER_FORCE * most, most - LAST_RISE)
        late = descent.last_crossing(level)
    rise, rise_std, compliance = last_stretch(descent, level, late)
    # Look for a rigid surface below a soft layer, and fit the whole curve as a spring.
    through = contact_height_if_rigid(descent, late, first)
    onset = Onset(first, first_std, through, max(first - deepest, 0.0) / most)
    lever, lever_std = force_lever(descent, trace.hand)
    # Below a soft layer the values at the greatest force count, else those of the recording.
    below = knee(descent, late, first)
    full, held = (most, deepest) if below else (descent.full, descent.held)
    return SurfaceTouch(
        recording,
        descent,
        samples.pose_world_tcp[descent.pressed, :2].mean(axis=0),
        held,
        full,
        rise,
        rise_std,
        compliance=compliance,
        knee=below,
        bottomed=through,
        first=first,
        first_std=first_std,
        lever=lever,
        lever_std=lever_std,
        lean=largest_lean(descent),
        opening=float(np.median(samples.width[descent.pressed])),
        own=trace.hand.tip_compliance,
        own_std=trace.hand.tip_compliance_std,
        out_of_level=max(LEANS_OVER, trace.hand.tip_offset_std / REACH),
        level_std=trace.hand.tip_offset_std / REACH,
        spring=fit_spring(descent, onset, trace.hand),
    )


def last_stretch(descent: Descent, level: float, late: int) -> tuple[float, float, float]:
    """Fit the last stretch of the loading curve from the force `level`, N, at row `late`.

    Returns:
        Force rise, N; its standard deviation by joint friction, N; and compliance, m/N.
    """
    z, force = descent.z, descent.smooth
    most, deepest = at_most(descent)
    # The rows begin after the running median has left the impact, and end with the commanded motion.
    stop = int(np.argmin(descent.samples.target_world_tcp[:, 2]))
    rows = np.arange(late + SUSTAINED // 2 + 1, stop + 1)
    rise = float(np.ptp(force[rows])) if len(rows) >= BLOCK_ROWS else 0.0
    if rise >= LEAST_RISE:
        # Slope of z(F) while the joints hardly move, so that their friction is constant. Add the
        # travel of the tip after the greatest force, which a rigid surface forbids.
        slope = float(np.polyfit(force[rows], z[rows], 1)[0])
        sunk = max(float(z[np.argmax(force)]) - deepest, 0.0)
        return rise, float(descent.wander[2]), max(-slope, 0.0) + sunk / rise
    # Too small a rise for a slope: difference to rest. Friction relaxes by an unknown part.
    rise = most - level
    sunk = float(np.median(z[late - 2 : late + 3])) - deepest
    return rise, descent.friction, max(sunk, 0.0) / rise


def largest_lean(descent: Descent) -> float:
    """Find the largest lean of the hand against free air, rad.

    It is the largest of the running median until the greatest force, and of the recorded pose.
    """
    lean = leans(descent.samples)
    lean = lean - np.median(lean[descent.free])
    # Leave out the rows between the greatest force and the recording: the hand oscillates there.
    most = max(int(np.argmax(descent.smooth)), descent.onset + 1)
    pressing = running_median(lean[descent.onset : most])
    seen = np.append(pressing, np.median(lean[descent.pressed]))
    return float(seen[int(np.argmax(np.abs(seen)))])


def force_lever(descent: Descent, hand: NominalHand) -> tuple[float, float]:
    """Compute the offset of the contact force from the middle of the fingertips, m, and its standard deviation, m.

    The offset is along the closing direction.
    """
    samples, pressed = descent.samples, descent.pressed
    wrench = samples.wrench
    # Contact wrench: the held pose less free air.
    change = np.mean(wrench[pressed], axis=0) - np.median(wrench[descent.free], axis=0)
    closing, tool = mean_pose(samples.where(pressed)).rotation.T[1:]
    # A force F at p from the tips has the moment p × F. The tips at r from the TCP add r × F.
    force = change[:3]
    moment = change[3:] - np.cross(hand.tip_offset * tool, force)
    place = np.cross(force, moment) / float(force @ force)
    about = np.cross(tool, closing)
    # Error of the moment. Joint friction relaxes by about its value at the start, about any axis.
    # Friction that depends on the posture varies in a soft layer as in free air. A moment repeats
    # to `TORQUE_LEVER` times the force repeatability.
    friction = float(np.linalg.norm(descent.set_out[3:5]))
    wander = float(np.linalg.norm(descent.wander[3:] * about))
    through = FREE_SLOPE * abs(float(descent.z[descent.onset]) - descent.held)
    stuck = TORQUE_LEVER * float(np.hypot(hand.force_repeatability, through))
    doubt = float(np.linalg.norm([stuck, friction, wander]))
    return float(place @ closing), doubt / descent.full
