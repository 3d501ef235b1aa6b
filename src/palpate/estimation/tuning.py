"""Every tuning number of the estimators: its value, its unit, why it has it, how sensitive it is.

*Sensitive* says what becomes of an estimate when the number is halved or doubled (one that cannot
exceed 1: half way to 1): by how many of its own standard deviations σ it moves at most, and between
which factors its standard deviation changes, of 28 estimates: four bundled scenarios and synthetic
recordings, at the noise of `lab` and `datasheet`. *Hardly* is less than 0.05 σ and 5 %; *no* is a
threshold between cases that lie far apart, or a prior that says nothing.

What an arm and a hand are known for (the length of the tips, the datasheet's accuracies) is not
tuned: it comes with the trace, in `trace.hand`.
"""

from __future__ import annotations

# Tests of fit.

FALSE_ALARM = 1e-4
"""Probability that one test of fit fails although the model holds: an estimate rests on up to ten,
and some thousand innocent ones in a row shall stay identified. Sensitive: no."""

# Cutting a trace into rests and passes.

SETTLE = 0.15
"""s after the commanded pose stopped moving: the impedance controller's transient. Sensitive: mass
0.1 σ; friction 0.2 σ, std ×1.0–1.1; com 0.2 σ."""

START = 0.06
"""s before the commanded pose moves on: a smooth start accelerates before it visibly moves.
Sensitive: com 0.08 σ, std ×0.9–1.0."""

STILL_SPEED = 0.001
"""m/s: below this the TCP counts as at rest. Sensitive: mass 0.1 σ; friction 0.2 σ, std
×1.0–1.1; com 0.2 σ."""

NEAR = 0.012
"""m off the measured pose that a rest may be and still count as the same pose (a loaded arm sags
by m g / k). Sensitive: no."""

NEAR_ANGLE = 0.06
"""rad off the measured orientation, likewise. Sensitive: no."""

CORRIDOR = 0.02
"""m beside the line from the grasp to the measured pose that a pass may run. Sensitive: mass 0.7
σ, std ×1.0–1.3."""

CLEARANCE = 0.015
"""m of the path above the grasp left out: there the support may still carry part of the object.
Sensitive: mass 0.7 σ, std ×0.9–1.1; com 0.2 σ, std ×0.8–1.4."""

SHORT_LIFT = 0.4
"""part of the path left out instead where the lift is short. Sensitive: no."""

COVERED = 0.4
"""part of the lift that a pass must cover, so that all passes have bins in common. Sensitive:
mass 1.5 σ, std ×1.0–1.5."""

LIFT_MIN = 0.02
"""m: a lift shorter than this is no path to compare passes on. Sensitive: no."""

REST_ROWS = 5
"""rows at least that make a rest, so that their mean has a scatter. Sensitive: mass 0.08 σ."""

ARRIVAL = 0.02
"""m: the last stretch before a rest, whose direction tells how the joints' friction was left.
Sensitive: no."""

ALONG = 0.7
"""cosine between that stretch and the path from which the rest was reached along the path.
Sensitive: mass 0.2 σ, std ×0.9–1.0."""

PASS_SPEED = 0.01
"""m/s along the path from which the joints certainly slide. Sensitive: mass 0.2 σ, std ×0.9–1.1;
com 0.1 σ, std ×1.0–1.1."""

PAUSE = 0.5
"""s between two stretches of one pass, at most: a motion changes its speed near things. Sensitive:
no."""

SPEED_SHORT = 0.02
"""s over which the speed is averaged before an acceleration is taken for what the arm's inertia
felt. Sensitive: mass 0.3 σ."""

SPEED_SMOOTH = 0.05
"""s over which the speed is averaged before it is asked whether the arm goes steadily: encoders are
noisy. Sensitive: mass 0.5 σ, std ×0.9–1.5."""

SHORT_BLOCK = 0.05
"""s: means over such blocks show the white noise; long enough for a filter of the signals to have
forgotten. Sensitive: mass 0.2 σ, std ×0.9–1.2."""

LONG_BLOCK = 0.25
"""s: means over such blocks show what is slower; some of them fit into the shortest pass.
Sensitive: mass 0.3 σ, std ×0.8–1.5."""

SMOOTH_DEGREE = 2
"""degree of the polynomial in time that is no noise of a stretch. Sensitive: mass 0.1 σ, std
×0.9–1.2."""

FLICKER_SPAN = 4.0
"""s for which white noise is averaged in a pass, to compare it with what is slower. Sensitive:
no."""

FLICKER_FREEDOM = 6.0
"""degrees of freedom of noise that is extrapolated from blocks of `LONG_BLOCK` to a run of some ten
seconds: its level is known to a factor of two or so. Sensitive: no."""

GAP = 3.0
"""sampling periods from which samples are missing. Sensitive: no."""

STANDS_OUT = 2.0
"""standard deviations by which long blocks scatter more than white noise lets them, before that is
taken for 1/f noise. Sensitive: mass 0.2 σ, std ×0.8–1.2."""

OVERLAP = 2.0
"""second differences of neighbouring blocks per independent one. Sensitive: mass 0.1 σ, std
×0.9–1.1."""

CHAIN_ROWS = 20
"""rows on which it is tried whether an arm's kinematics explain its wrench. Sensitive: no."""

CHAIN_FORCE = 0.5
"""N, median over those rows: where they differ by more, the wrench itself is taken. Sensitive:
no."""

STEADY = 0.05
"""m/s², up to which a row belongs to a pass: what the arm's own inertia does as it changes its
speed is far more than a load. Sensitive: mass 0.7 σ, std ×0.8–1.5."""

SAME_MOTION = 0.25
"""m/s², root mean square along the path: passes whose accelerations differ by more are not
compared. Sensitive: no."""

BINS = 10
"""bins along the path, so that all passes are compared at the same configurations. Sensitive: mass
0.3 σ."""

BLOCK = 0.1
"""s: samples of a drag are averaged over blocks of this length before their scatter is taken, so
correlation counts. Sensitive: friction 0.07 σ, std ×1.0–1.1."""

UNKNOWN_NOISE = 0.01
"""N², (N m)²: variance of a row where no rest is long enough to show it. Sensitive: no."""

# The load from the contrast of rests and passes.

FORCE_BIAS = 0.5
"""N (1 sigma): bias of an unreferenced force; Franka states 0.8 N relative accuracy. Sensitive:
hardly; without any pass or rest of the empty hand it is most of a mass's std."""

TORQUE_LEVER = 0.3
"""m: what turns the force figures here into moments about the TCP (typical lever of the arm's
wrist joints). Sensitive: com 0.07 σ, std ×0.9–1.1."""

KIND_BIAS = 0.3
"""N (1 sigma): how far the bias of one kind of segment lies from the common one, and its slope and
curvature along the path (friction hysteresis). Sensitive: mass 0.08 σ; com 0.1 σ."""

CENTRIFUGAL = 8.0
"""N s²/m² (1 sigma): what the square of the speed makes of a force; equal motions compare best.
Sensitive: hardly."""

DEGREE = 3
"""degree of the polynomial along the path that the bias of one direction of travel follows.
Sensitive: mass 0.2 σ."""

DRIFT = 0.033
"""N (1 sigma): how far the sensors' zero wanders; 0.01 N m in a joint. No published figure: some
0.2 permille of the range of a large joint's strain gauges. Sensitive: mass 0.3 σ, std ×1.0–1.1."""

DRIFT_TIME = 300.0
"""s in which it forgets where it was. No published figure. Sensitive: mass 0.15 σ."""

FLICKER_TIMES = tuple(0.3 * 4.0**i for i in range(6))
"""s: time constants of the processes whose sum is 1/f noise; from what blocks see to the length of
a long run. Sensitive: hardly."""

APPARENT_MASS = 10.0
"""kg (1 sigma): apparent vertical mass at the TCP, wide enough for any seven-axis arm. Sensitive:
mass 0.1 σ."""

INERTIA_DEGREE = 1
"""degree of the polynomial along the path that the arm's apparent mass follows. Sensitive:
hardly."""

UNSTEADY = 0.15
"""kg (1 sigma), times the acceleration: what is not known of a force while the speed changes, bin
by bin; some per cent of the arm's apparent mass. Sensitive: no, where passes are steady."""

VISCOUS = 1.0
"""N s/m (1 sigma): what the speed makes of a force; friction of 0.07 N m s/rad at a lever of half a
metre is a third of it. Sensitive: hardly."""

BIN_BIAS = 0.03
"""N (1 sigma): what the polynomial leaves of the bias at one place of the path (gear waves).
Sensitive: mass 0.08 σ."""

REST_FRICTION = 0.1
"""N (1 sigma): friction that is another at every rest, though the arm came the same way. Sensitive:
mass 0.08 σ."""

PULL_SMALL = 0.05
"""N/m (1 sigma): a force that grows with the height so little is no contradiction. Sensitive:
no."""

PULL_SHARE = 0.03
"""1/m (1 sigma), part of the load: likewise; levers of joints are not known better along a lift,
and loads in a perfect world read up to 5 % a metre off. Sensitive: no."""

SIDE_SMALL = 0.02
"""N (1 sigma): a force to the side so small is no contradiction: less than half of what such arms
resolve. Sensitive: no."""

RUB_SHARE = 0.002
"""part of the load (1 sigma), likewise: friction in a joint grows with what it bears by about so
much. Sensitive: no."""

RUB_SMALL = 0.005
"""N (1 sigma): a load that differs so little between directions, between rest and pass and between
weighings is no contradiction: a tenth of the force that such arms resolve. Sensitive: no."""

TELLING = 0.1
"""part of `LOAD_PRIOR`: a term known no better than that cannot be told from the load. Sensitive:
no."""

LOAD_ITERATIONS = 3
"""solutions after the first: what gains and tilts do is in proportion to the load. Sensitive:
no."""

FLOOR = 1e-4
"""N: noise that is always assumed, lest perfect sensors make the equations singular. Sensitive:
no."""

LOAD_PRIOR = 1e3
"""N (1 sigma) of the load: nothing is known of it. Sensitive: no."""

# Centre of mass.

GRASP_ACCURACY = 7e-4
"""m (1 sigma): how far a grasp may shift the object from where it is believed to be in the hand.
Sensitive: com std ×0.9–1.1."""

AT_GRASP = 0.05
"""s before and after the hand closed, over which its pose is averaged. Sensitive: no."""

PLACE_ACCURACY = 5e-4
"""m (1 sigma): how far a scene whose poses were measured may have an object from where it is.
Sensitive: com std ×0.9–1.2."""

ARM_WEIGHT = 100.0
"""N m per m: moment that the arm's own weight, which is known where the arm says it is, seems to
make at the hand where it is beside that. Sensitive: no."""

SEEN = 0.05
"""part of a coordinate that gravity must show at some grasp for it to be seen. Sensitive: no."""

COM_PRIOR = 0.25
"""part of the object's extent that is the 1 sigma of a coordinate of the centre of mass before
measuring. Sensitive: com std ×0.5–2.0."""

BLIND = 0.5
"""part of that 1 sigma that must be left for a coordinate to count as not measured. Sensitive:
no."""

# Height: what a guarded descent met.

DESCENDING = 0.3
"""part of the highest commanded speed from which the arm descends. Sensitive: no."""

SUSTAINED = 9
"""rows, 45 ms, whose running median is a force: up to four wild samples in a row are no contact.
Sensitive: hardly."""

CONTACT_NOISE = 4.0
"""standard deviations of the noise that a force must exceed to be contact. Sensitive: hardly."""

SOFT_FORCE = 0.15
"""N: a lower force is none; the repeatability of a force that the datasheet states. Sensitive:
hardly."""

SPEED_CHANGE = 0.05
"""m/s² of the commanded motion from which it changes its speed; a steady descent has none.
Sensitive: no."""

SWING = 0.3
"""s after a change of the commanded speed in which the arm still swings on its springs. Sensitive:
no."""

SWINGING = 0.1
"""weight of a row at which it does. Sensitive: hardly."""

FREE_SLOPE = 5.0
"""N/m (1 sigma): how the force in free air changes along the way down, by friction and gravity that
change with the place. Sensitive: hardly."""

FREE_SLOPE_STD = 1.0
"""N/m (1 sigma): how well the change of the force on the way down is known to go on. Sensitive:
stiffness below 200 N/m, std ×0.7–1.6."""

CANDIDATES = 50
"""places of the first contact that are tried before the best of them is refined. Sensitive: no."""

FREE_ROWS = 60
"""rows, 0.3 s, of free air before the contact, to which the moment of the contact is referred.
Sensitive: no."""

LATE_FORCE = 0.6
"""part of the pressing force from which the last stretch of the loading curve reaches to all of
it: reached before the arm is told to stop, whose swing would disturb it. Sensitive: hardly."""

STIFF_SHARE = 0.1
"""part of the way through something soft that still belongs to the stiff stretch below it.
Sensitive: hardly."""

CURVE_ROWS = 5
"""rows at least that make a line. Sensitive: no."""

UNSEEN = 2e-5
"""m (1 sigma): penetration of a rigid surface that no loading curve shows. Sensitive: no."""

STIFF = 2e-5
"""m/N: below this a contact is stiff, and the correction for its penetration small. A steel or
stone table gives way by 1 to 10 µm/N. Sensitive: no."""

RIGID = 6e-5
"""m/N: what gives way more than this is no rigid surface. A light table does by up to 40 µm/N: a
board of 18 mm chipboard, 0.6 m wide and 1.2 m long, borne at its ends, 48 E I / L³ with E of 3 GPa.
Hard pads and the joints behind the encoders add some 20. Sensitive: no."""

SOFT = 0.0015
"""m above the rigid surface from which an earlier rise of the force is something soft.
Sensitive: no."""

SOFT_ACCURACY = 2e-3
"""m (1 sigma): what is soft has no sharp beginning. Sensitive: `soft onset` std ×0.5–2.0."""

SOLID = 0.05
"""part (1 sigma) of the thickness of what is soft that stays however hard it is pressed: relative
density of flexible foams, 0.02 to 0.1 (Gibson & Ashby, Cellular Solids). Sensitive: height std
×0.6–1.9, only where something soft was pressed through."""

CORRECTION = 0.25
"""part (1 sigma) of the correction for penetration: contacts are not quite linear. Sensitive:
hardly."""

YIELDING = 0.5
"""part (1 sigma) of the correction for penetration where the surface is not stiff. Sensitive:
height std ×0.6–1.9, only there."""

AT_REST = 0.1
"""s before a descent in which the arm rests, which tells how its friction turns round as it sets
out. Sensitive: stiffness hardly."""

STIFFER = 0.2
"""part of a surface's compliance so far, below which it has been pressed through: an even spring
keeps all of it, one that hardens with the square of the depth 0.44, a table none. Sensitive: no."""

ALIKE = 3.0
"""rows of a descent per independent one: the torque sensors' signal wanders, and the model leaves
the arm's swing out. Sensitive: stiffness std ×0.8–1.3."""

WILD = 6.0
"""standard deviations of the noise off its running median from which a sample is left out.
Sensitive: no."""

RESTING_SPEED = 0.002
"""m/s below which the joints' friction begins to let go. Sensitive: stiffness hardly."""

ARM_MASS = (6.0, 3.0)
"""kg, mean and 1 sigma: apparent vertical mass at the TCP, wide enough for any seven-axis arm.
Sensitive: stiffness hardly."""

DISSIPATING_MASS = 1.0
"""kg, whose critical damping on the surface is the 1 sigma of what it dissipates. Sensitive:
stiffness hardly."""

STIFFEST = 1e9
"""N/m (1 sigma) of a surface: nothing is known of it. Sensitive: no."""

WEAKEST = 1.0
"""N/m: a surface that 8 N press 8 m down is none; it keeps a compliance finite. Sensitive: no."""

SEARCHES = (25, 25, 25, 25)
"""places of the first contact that are tried in each of several rounds, the next one about the best
of the last: to a thousandth of a millimetre within 20 mm. Sensitive: no."""

RESOLVED = 1.0 / 3.0
"""part of a compliance that its standard deviation may be for a stiffness to have an upper end.
Sensitive: no."""

BLOCK_ROWS = 20
"""rows, 0.1 s, of a descent over whose means white noise is small beside what else there is.
Sensitive: no."""

SPRING_MISFIT = 1.0
"""times what chance and the joints' friction would leave of the force's means, root mean square, that
a spring may leave. Sensitive: no."""

APART = 0.05
"""m: three touches so far from one another show how a surface leans; 0.1 mm between two touches is
2 mrad. Sensitive: no."""

# Friction: drags along a support.

DRAG_SPEED = 0.002
"""m/s, commanded and horizontal, from which a row belongs to a drag. Sensitive: no."""

DRAG_SLOPE = 0.3
"""vertical over horizontal commanded speed up to which a motion is a drag. Sensitive: friction 0.7
σ, std ×0.6–1.0."""

DRAG_ROWS = 20
"""rows that a drag must exceed, so that it has a beginning and a later half. Sensitive: no."""

STEADY_ROWS = 10
"""rows of steady sliding from which a drag counts. Sensitive: no."""

CRUISE = 0.95
"""part of the usual commanded speed from which the motion is at its full speed. Sensitive:
friction 1.5 σ, std ×1.0–2.0."""

LATE = 0.5
"""part of a drag after which its quotient of forces is the usual one. Sensitive: friction 1.7 σ,
std ×0.9–1.0."""

SLIDING = 0.85
"""part of the usual quotient of forces from which the object may be sliding: before, it turns in
the fingers' grip. Sensitive: friction 0.8 σ, std ×1.0–1.9; `static` 2.6 σ."""

FOLLOWING = 0.7
"""part of the commanded speed at which the hand follows; slower, the object may have stuck
again. Sensitive: no."""

PEAK_WITHIN = 0.3
"""s after that in which the breakaway lies. Sensitive: friction 1.7 σ, std ×0.9–1.7."""

SMOOTH = 0.02
"""s: forces are averaged over this before the breakaway is looked for. Sensitive: friction 2.1 σ,
std ×0.9–1.8; `static` 1.0 σ."""

TRANSIENT = 0.25
"""s after breakaway in which the spring between arm and object still swings. Sensitive: friction
2.7 σ, std ×0.8–1.3."""

DOWN = 0.006
"""m above the grasp that the hand may be while the object is on its support. Sensitive: no."""

HANGING = 0.02
"""m above the grasp from which the object hangs free. Sensitive: no."""

HORIZONTAL_MASS = 5.0
"""kg, of a 7-axis arm at its TCP, horizontally: what its acceleration at breakaway takes of the
force. Sensitive: friction 0.6 σ; `static` 1.5 σ."""

GAIN_RATIO = 0.8
"""part of a gain's half width that a quotient of two forces is wrong by (1 sigma): different
joints carry them, sqrt(2) times a uniform error, 1/sqrt(3). Sensitive: friction std ×0.6–1.9."""

NORMAL_MIN = 0.5
"""N: below this the quotient of forces says nothing. Sensitive: no."""

FRICTION_PRIOR = 10.0
"""1 sigma of a coefficient: nothing is known of it. Sensitive: no."""

TILT = 0.009
"""rad (1 sigma): how far a support is out of level, half a degree; slides both ways show it.
Sensitive: friction 0.1 σ; std of a slide one way ×0.8–1.7."""

PULL = 20.0
"""N/m (1 sigma): what pulls with the place, a cable or a leash; a normal force that rises and
falls shows it. Sensitive: friction 0.1 σ."""

CURVE = 0.05
"""N (1 sigma) at `HALF_WAY`: curvature of the arm's bias along a slide. Sensitive: friction 0.2 σ,
std ×0.9–1.1."""

HALF_WAY = 0.03
"""m: half of the shortest slide that a plan makes for a friction. Sensitive: friction 0.3 σ, std
×0.9–1.1."""

SAME_LINE = 0.95
"""cosine between the ways of two drags on one line. Sensitive: no."""

PRESLIDING = 2e-3
"""rad over which the friction in a joint turns round: the usual order for harmonic drives.
Sensitive: `static` hardly, std ×0.9–1.1."""

JOINT_TORQUE = 0.06
"""N m (1 sigma) of the friction behind a joint's sensor: a few hundredths to a tenth. Sensitive:
friction std ×0.9–1.3."""

JOINT_FRICTION = 0.2
"""N (1 sigma) at the hand of one joint's friction. Sensitive: `static` 0.1 σ, std ×0.9–1.3."""

CORRELATED_BLOCKS = 3.0
"""blocks: what the model of a drag leaves out is the same in about so many neighbouring ones.
Sensitive: friction std ×0.8–1.3."""

SLIDING_NOISE = 1e-3
"""N: noise of a block that is always assumed. Sensitive: no."""

HORIZONTAL_SPREAD = 2.0
"""kg (1 sigma) of `HORIZONTAL_MASS`, with the hand turning as it lets go. Sensitive: `static` 0.3
σ, std ×0.6–1.8."""

STICKING = 0.1
"""part of the rows of steady sliding in which the hand may lag behind its command; an object that
sticks and slips holds it back most of the time. Sensitive: no."""

ROUGH = 10.0
"""times the noise that is expected of a drag, from which it is chatter. Sensitive: no."""

SMOOTH_NOISE = 0.03
"""N², of a row: noise that moving adds to that at rest, of ripples in gears and encoders: 0.04 N in
means of 0.1 s. Sensitive: no."""

LIKELY_FRICTION = 2.0
"""coefficient beyond which nothing dry slides on anything. Sensitive: no."""

SIGNIFICANT = 2.0
"""standard deviations from zero from which a friction is identified. Sensitive: no."""

# Position.

CENTRING = 0.0015
"""m (1 sigma): fingers centre an object on themselves as they close; in simulated grasps it
ended up to 2.5 mm from where it had stood. Sensitive: position std ×0.5–2.0."""
