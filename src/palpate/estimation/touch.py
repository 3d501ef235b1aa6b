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
"""m: three touches so far from one another show how a surface leans; 0.1 mm between two touches is 2 mrad.
Sensitive: no."""


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """Plane through the touches of a surface.

    Attributes:
        height: m, of its middle among the touches.
        std: m, without what all touches share.
        tilt: rad, from level, and its standard deviation; None where the touches do not span a
            plane.
        slope: (2,) rise along x and along y, and slope_std; None where they do not.
        misfit: sum of the squared residuals over their variances.
        freedom: number of touches beyond the unknowns.
        beside, heights, stds: of the touches: (n, 2) m from their middle, (n,) m, (n,) m.
    """

    height: float
    std: float
    tilt: tuple[float, float] | None
    misfit: float
    freedom: int
    slope: Array | None
    slope_std: Array | None
    beside: Array
    heights: Array
    stds: Array

    @property
    def fitted(self) -> Array:
        """(n,) m, height of the plane at each touch."""
        rise = 0.0 if self.slope is None else self.beside @ self.slope
        return np.full(len(self.heights), self.height) + rise

    def view(self, of_tilt: bool) -> FitView:
        """Touches against the plane, from the side along its steepest direction; `of_tilt`: of an estimate of its
        tilt, else of its height."""
        # Touches too close together for a slope are shown along world x.
        slope = np.array([1.0, 0.0]) if self.slope is None else self.slope
        uphill = slope / max(float(np.linalg.norm(slope)), 1e-12)
        heading = float(np.degrees(np.arctan2(uphill[1], uphill[0])))
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
    """Fit the plane through touches at `spots` (n, 2), m, by weighted least squares; where they do not span
    one, their weighted mean."""
    z, weight = np.asarray(heights), 1.0 / np.asarray(stds)
    middle = spots.mean(axis=0)
    level = np.ones((len(z), 1))
    leaning = np.hstack([level, spots - middle])
    design = leaning if spans_plane(spots) else level
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
        # The height of a tilted surface, one number, is as uncertain as the touches differ along the slope
        # (root mean square).
        rise: Array = (spots - middle) @ slope
        variance += float(np.mean(rise**2))
    freedom = len(z) - len(solution)
    height, std = float(solution[0]), float(np.sqrt(variance))
    touches = spots - middle, z, np.asarray(stds)
    return Plane(height, std, tilt, misfit, freedom, slope, slope_std, *touches)


def spans_plane(spots: Array) -> bool:
    """Three of the spots are at least `APART` from one another, and not collinear."""
    if len(spots) < 3:
        return False
    # Spread along the shorter main axis: APART / sqrt(6) of an equilateral triangle with sides APART; half of
    # that is still no line.
    centred = spots - spots.mean(axis=0)
    variances = np.linalg.eigvalsh(centred.T @ centred / len(spots)).astype(np.float64)
    return float(variances[0]) >= (APART / 2) ** 2 / 6


# Touch of a surface by a guarded descent: tip height over pressing force, from the first contact
# on.


LATER_FORCE = 0.66
"""the same below something soft, which may bear as much. Sensitive: cloths of some 400 N/m, foams in layers."""
LAST_RISE = 6.0
"""N of rise at most of the last stretch below something soft: a press goes on for 8 N after something rigid stops the
tips (`vocabulary.contact`). Sensitive: cloths that bear more than 12 N."""
LEAST_RISE = 1.5
"""N by which the force changes in that stretch at least for its slope to count. Sensitive: no."""
STIFF = 2e-5
"""m/N: below this a contact is stiff, and the correction for its penetration small. A steel or stone table gives way
by 1 to 10 µm/N. Sensitive: no."""
RIGID = 6e-5
"""m/N: what gives way more than this is no rigid surface. A light table does by up to 40 µm/N: a board of 18 mm
chipboard, 0.6 m wide and 1.2 m long, borne at its ends, 48 E I / L³ with E of 3 GPa. Hard pads and the joints behind
the encoders add some 20. Sensitive: no."""
SURE = 1.0
"""standard deviations by which what stopped the tip must be less than that to count as rigid: with the tips of an
arm that nobody measured (15 µm/N) that tells a table of 20 µm/N from a mat of 80 by 1.6 and 2.3 more. Sensitive: no,
where tips are known."""
SOLID = 0.05
"""part (1 sigma) of the thickness of what is soft that stays however hard it is pressed: relative density of
flexible foams, 0.02 to 0.1 (Gibson & Ashby, Cellular Solids). Sensitive: height std ×0.6–1.9, only where something
soft was pressed through."""
CORRECTION = 0.25
"""part (1 sigma) of the correction for penetration: contacts are not quite linear. Sensitive: hardly."""
YIELDING = 0.5
"""part (1 sigma) of the correction for penetration where the surface is not stiff. Sensitive: height std ×0.6–1.9,
only there."""
LEANS_OVER = 3.3e-3
"""rad by which a contact makes the hand lean over where one finger alone stands on something. Against a level
surface an arm that nobody calibrated is out by 1.2 mrad (1 sigma: 1 mrad in each joint that turns it over, and a
base levelled to 0.5); 30 N on one finger lean it over by 4.2 mrad at 280 N m/rad. Sensitive: no."""
REACH = 0.5
"""m from the base to where an arm touches: what leans by an angle is off there by as much in height, and an arm
whose owner says that its fingertips are off by more leans by more. Sensitive: no."""
VIEW_ABOVE = 0.006
"""m of free air that a chart of a touch shows at least. Sensitive: no."""


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceTouch:
    """Contact at the end of a guarded descent.

    Attributes:
        recording: of the held pose.
        spot: (2,) m, world x and y of the fingertips.
        held: m, tip height at the force `full`, N, at rest: of the recording, or before a press through
            something soft was eased, as the tip may rise into that again.
        rise: N, of the last stretch, with its standard deviation by joint friction.
        compliance: m/N, of the last stretch of the loading curve.
        knee: N, force at the beginning of that stretch; 0 where it began in free air.
        bottomed: m, tip height at which something soft had been pressed through; None without such.
        first: m, tip height at which the force began to rise, with its standard deviation.
        lever: m along the closing direction from the middle of the fingers to the line of the force, with its
            standard deviation.
        lean: rad, largest lean of the hand in that direction by the contact.
        opening: m, between the fingers.
        own: m/N, compliance of the tips themselves, with its standard deviation.
        out_of_level: rad, uncertainty of the level of the arm against the surface.
        spring: the surface as a spring, above a stiff support.
    """

    recording: Recording
    descent: Descent
    spot: Array
    held: float
    full: float
    rise: float
    rise_std: float
    compliance: float
    knee: float
    bottomed: float | None
    first: float
    first_std: float
    lever: float
    lever_std: float
    lean: float
    opening: float
    own: float
    own_std: float
    out_of_level: float
    spring: Spring

    @property
    def height(self) -> float:
        """Height of the rigid surface extrapolated to zero force, m; of a compliant one, that of
        first contact."""
        return self.first if self.gives_way else self.held + self.penetration

    def height_std(self, hand: NominalHand) -> float:
        """Standard deviation of the height, m, of one touch, without the length of the tips that all touches
        share."""
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
        """Depth of the held tip below the surface, m."""
        whole = max(self.first - self.held, 0.0)
        if self.gives_way:
            return whole
        # Along the last stretch, as long as it leads to the first contact: a swing of the arm disturbs it,
        # and then the whole curve counts.
        stretch = self.compliance * max(self.full - self.knee, 0.0)
        if self.knee > 0.0 or abs(whole - stretch) < 2.0 * self.first_std:
            return stretch
        return whole

    @property
    def at_most(self) -> float:
        """Upper bound of the compliance of the surface alone, m/N, at `SURE` standard deviations: from the
        spring, or below something soft from the last stretch."""
        if self.knee == 0.0:
            return self.spring.at_most(SURE)
        return self._compliance_bound(-SURE) - self.own + SURE * self.own_std

    @property
    def at_least(self) -> float:
        """Lower bound of the compliance, m/N."""
        if self.knee == 0.0:
            return self.spring.at_least(2.0)
        return self._compliance_bound(2.0) - self.own - 2.0 * self.own_std

    def _compliance_bound(self, sigmas: float) -> float:
        """Compliance of the last stretch, m/N, if the force had risen by so many standard deviations more."""
        risen = max(self.rise + sigmas * self.rise_std, SOFT_FORCE)
        return self.compliance * self.rise / risen

    @property
    def pressed_through(self) -> bool:
        """Something soft was met above what stopped the tip."""
        return self.bottomed is not None or self.knee > 0.0

    @property
    def gives_way(self) -> bool:
        """The surface is not known to be rigid."""
        return self.at_most > RIGID

    @property
    def soft(self) -> float:
        """Thickness of something soft that was pressed through, m; 0 without such."""
        thickness = self.first - self.height
        return thickness if thickness > SOFT and not self.gives_way else 0.0

    def firm(self) -> FitTest:
        """Test for a rigid surface."""
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
        """Tests for contact of both fingers, by the lean and the moment: of one finger alone, the force acts
        nearer to it than to the middle, and the hand leans to the other side."""
        lower = abs(self.lean) * self.opening
        yield FitTest(
            "both fingers stand",
            abs(self.lean),
            self.out_of_level,
            f"One finger alone stands on something: the hand leans over by {1e3 * abs(self.lean):.1f} "
            f"mrad, and the other finger, {1e3 * lower:.1f} mm lower for it, meets nothing.",
        )
        nearer = self.opening / 4
        if 2.0 * self.lever_std >= nearer:
            return
        beside = abs(self.lever)
        finding = (
            f"One finger alone stands on something: the force acts {1e3 * beside:.0f} mm beside the "
            "middle of the hand, on a thing or a slope under that finger."
        )
        yield FitTest("both fingers", beside, nearer, finding)


def touches_of(trace: Trace, recordings: Iterable[Recording]) -> list[SurfaceTouch]:
    """Touches of the guarded descents before recorded poses that met a resistance.

    Raises:
        ValueError: as `find_touch`.
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
    """Charts of the touches and of the `plane` through them. `slopes` (p,): change of the height with each
    component of the estimate; by default it is the height itself."""
    effect = np.ones(1) if slopes is None else slopes
    pairs = zip(touches, plane.fitted.tolist(), strict=True)
    curves = tuple(loading_curve_view(touch, height, effect) for touch, height in pairs)
    if len(touches) == 1 or slopes is not None:
        return curves
    return plane.view(of_tilt=False), *curves


def loading_curve_view(touch: SurfaceTouch, height: float, effect: Array) -> FitView:
    """Loading curve of a touch against the surface at `height`, m: its last stretch, carried back."""
    descent, met = touch.descent, max(height, touch.first)
    # So much free air above the contact is shown.
    rows = descent.z <= met + max(VIEW_ABOVE, 0.4 * (met - float(descent.z.min())))
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
    """Touch of the guarded descent before a recorded pose; None without a lasting resistance.

    Raises:
        ValueError: the recording holds no samples, or no guarded descent comes before it.
    """
    descent = descent_before(trace, recording)
    if descent is None:
        return None
    samples = descent.samples
    most, deepest = at_most(descent)
    level = LATE_FORCE * most
    late = descent.crossing(level)
    first, first_std = first_contact(descent, late)
    if first - float(descent.z[late]) > SOFT:
        # Something soft may bear that force.
        level = max(LATER_FORCE * most, most - LAST_RISE)
        late = descent.last_crossing(level)
    rise, rise_std, compliance = last_stretch(descent, level, late)
    through = contact_height_if_rigid(descent, late, first)
    onset = Onset(first, first_std, through, max(first - deepest, 0.0) / most)
    lever, lever_std = force_lever(descent, trace.hand)
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
        spring=fit_spring(descent, onset, trace.hand),
    )


def last_stretch(descent: Descent, level: float, late: int) -> tuple[float, float, float]:
    """Rise of the force in the last stretch of the loading curve, N, with its standard deviation by joint friction,
    and compliance, m/N: from the force `level`, N, at row `late`, on."""
    z, force = descent.z, descent.smooth
    most, deepest = at_most(descent)
    # From where the running median has left the impact to where the commanded motion ends.
    stop = int(np.argmin(descent.samples.target_world_tcp[:, 2]))
    rows = np.arange(late + SUSTAINED // 2 + 1, stop + 1)
    rise = float(np.ptp(force[rows])) if len(rows) >= BLOCK_ROWS else 0.0
    if rise >= LEAST_RISE:
        # Slope of z(F) while the joints hardly move, so that their friction stays; and how far the tip sinks in after
        # the greatest force, which a rigid surface forbids.
        slope = float(np.polyfit(force[rows], z[rows], 1)[0])
        sunk = max(float(z[np.argmax(force)]) - deepest, 0.0)
        return rise, float(descent.wander[2]), max(-slope, 0.0) + sunk / rise
    # To rest, as friction relaxes by an unknown part.
    rise = most - level
    sunk = float(np.median(z[late - 2 : late + 3])) - deepest
    return rise, descent.friction, max(sunk, 0.0) / rise


def largest_lean(descent: Descent) -> float:
    """Largest lean for several rows until the greatest force, or that while the pose was recorded, against
    free air, rad."""
    lean = leans(descent.samples)
    lean = lean - np.median(lean[descent.free])
    # In between, the hand swings.
    most = max(int(np.argmax(descent.smooth)), descent.onset + 1)
    pressing = running_median(lean[descent.onset : most])
    seen = np.append(pressing, np.median(lean[descent.pressed]))
    return float(seen[int(np.argmax(np.abs(seen)))])


def force_lever(descent: Descent, hand: NominalHand) -> tuple[float, float]:
    """Offset of the held force from the middle of the fingertips along the closing direction, m, and its
    standard deviation."""
    samples, pressed = descent.samples, descent.pressed
    wrench = samples.wrench
    change = np.mean(wrench[pressed], axis=0) - np.median(wrench[descent.free], axis=0)
    closing, tool = mean_pose(samples.where(pressed)).rotation.T[1:]
    # At a lever p from the tips the force F has the moment p x F; about the TCP the lever r of the tips adds r x F.
    force = change[:3]
    moment = change[3:] - np.cross(hand.tip_offset * tool, force)
    place = np.cross(force, moment) / float(force @ force)
    about = np.cross(tool, closing)
    # As the arm stops, joint friction relaxes by about as much as it showed when the arm set out, about any
    # axis; friction that changes with the place may do so on the way through a soft layer as in free air; and
    # a moment repeats to `TORQUE_LEVER` times the repeatability of a force.
    friction = float(np.linalg.norm(descent.set_out[3:5]))
    wander = float(np.linalg.norm(descent.wander[3:] * about))
    through = FREE_SLOPE * abs(float(descent.z[descent.onset]) - descent.held)
    stuck = TORQUE_LEVER * float(np.hypot(hand.force_repeatability, through))
    doubt = float(np.linalg.norm([stuck, friction, wander]))
    return float(place @ closing), doubt / descent.full
