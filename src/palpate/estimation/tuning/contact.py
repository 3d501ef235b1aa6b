"""Tuning numbers of height, stiffness, size and position."""

# Guarded descents: height and stiffness.

SUSTAINED = 9
"""rows, 45 ms, whose running median is a force: up to four wild samples in a row are no contact. Sensitive: hardly."""

CONTACT_NOISE = 4.0
"""standard deviations of the noise that a force must exceed to be contact. Sensitive: hardly."""

WRONG_BY = 12.0
"""standard deviations of what free air wanders by, from which on a rise over its line is something soft, though it
were less than what a datasheet says that a force may be wrong by. Where joints rub, free air makes up to 9 of it by
itself. Sensitive: mats of some 100 N/m that bear 1 N, not at all at half of it."""

STEEP = 50.0
"""N/m above which that counts: free air by itself changed by 9 to 40 N/m over 5 to 60 mm before a table (some 250
recorded descents of arms whose joints rub). Sensitive: mats below 60 N/m."""

SOFT_FORCE = 0.15
"""N: a lower force is none; the repeatability of a force that the datasheet states. Sensitive: hardly."""

SPEED_CHANGE = 1e-3
"""m/s within `SUSTAINED` rows from which the commanded motion changes its speed; a steady descent has none, though
stamps jitter and samples are missing. Sensitive: no."""

SWING = 0.3
"""s after a change of the commanded speed in which the arm still swings on its springs. Sensitive: no."""

SWINGING = 0.1
"""weight of a row at which it does. Sensitive: hardly."""

FREE_SLOPE = 5.0
"""N/m (1 sigma): how the force in free air changes along the way down, by friction and gravity that change with the
place. Sensitive: hardly."""

FREE_SLOPE_STD = 0.5
"""N/m (1 sigma): how well the change of the force on the way down is known to go on. Sensitive: stiffness below 200
N/m, std ×0.7–1.6."""

POSTURE = 0.2
"""m of descent over which what the joints' friction makes of a force, beyond what a force repeats to, becomes
another (1 sigma of all of it): levers are some tenths of a metre. Sensitive: stiffness below 500 N/m, std of arms
whose joints rub."""

RUBBED = 0.3
"""part (1 sigma) of that where it is foreseen, joint by joint: friction changes by some tenth with the place, the
load and from one motion to another, and gravity that a model leaves with the posture. Sensitive: stiffness below 500
N/m, std of arms whose joints rub."""

CANDIDATES = 50
"""places of the first contact that are tried before the best of them is refined. Sensitive: no."""

FREE_ROWS = 60
"""rows, 0.3 s, of free air before the contact, to which the moment of the contact is referred. Sensitive: no."""

LATE_FORCE = 0.6
"""part of the pressing force from which the last stretch of the loading curve reaches to all of it: reached before
the arm is told to stop, whose swing would disturb it. Sensitive: hardly."""

AT_REST_SHARE = 0.75
"""part of the largest force of a press that at least counts as its force at rest: joint friction, which relaxes as the
arm stops, may hide the rest. Sensitive: of 100 tables at `measured` four were taken for something soft 60 to 150 mm
above without it, one at 0.5."""

LATER_FORCE = 0.66
"""the same below something soft, which may bear as much. Sensitive: cloths of some 400 N/m, foams in layers."""

LAST_RISE = 6.0
"""N of rise at most of the last stretch below something soft: a press goes on for 8 N after something rigid stops the
tips (`vocabulary.contact`). Sensitive: cloths that bear more than 12 N."""

LEAST_RISE = 1.5
"""N by which the force changes in that stretch at least for its slope to count. Sensitive: no."""

STIFF_SHARE = 0.1
"""part of the way through something soft that still belongs to the stiff stretch below it. Sensitive: hardly."""

CURVE_ROWS = 5
"""rows at least that make a line. Sensitive: no."""

UNSEEN = 2e-5
"""m (1 sigma): penetration of a rigid surface that no loading curve shows. Sensitive: no."""

CONTRADICTS = 3.0
"""standard deviations by which the depth of the held tip must exceed what the loading curve says of it, to count
against it: friction that wanders in free air passes for an early first contact. Sensitive: of 52 rigid tables at
`measured` two were taken for compliant ones at 1, one at 3."""

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

SOFT = 0.0015
"""m above the rigid surface from which an earlier rise of the force is something soft. Sensitive: no."""

SOFT_ACCURACY = 2e-3
"""m (1 sigma): what is soft has no sharp beginning. Sensitive: `soft onset` std ×0.5–2.0."""

SOLID = 0.05
"""part (1 sigma) of the thickness of what is soft that stays however hard it is pressed: relative density of
flexible foams, 0.02 to 0.1 (Gibson & Ashby, Cellular Solids). Sensitive: height std ×0.6–1.9, only where something
soft was pressed through."""

CORRECTION = 0.25
"""part (1 sigma) of the correction for penetration: contacts are not quite linear. Sensitive: hardly."""

YIELDING = 0.5
"""part (1 sigma) of the correction for penetration where the surface is not stiff. Sensitive: height std ×0.6–1.9,
only there."""

AT_REST = 0.1
"""s before a descent in which the arm rests, which tells how its friction turns round as it sets out. Sensitive:
stiffness hardly."""

STIFFER = 0.2
"""part of a surface's compliance so far, below which it has been pressed through: an even spring keeps all of it,
one that hardens with the square of the depth 0.44, a table none. Sensitive: no."""

ALIKE = 3.0
"""rows of a descent per independent one: the torque sensors' signal wanders, and the model leaves the arm's swing
out. Sensitive: stiffness std ×0.8–1.3."""

APART_IN_TIME = 2.6e-3
"""s (1 sigma) by which force and motion of a sample are apart: a cycle of 1 ms, and a filter of 100 Hz, 1.6 ms. A
spring's force that comes late is damping. Sensitive: damping std above 3 kN/m."""

FRICTION_SLOWS = 0.15
"""part (1 sigma) of the friction that joints show as the arm sets out, by which it is another as they slow down in a
press: static over dynamic friction is 1.1, and friction changes with the place by 0.1 to 0.25 (noise models `hardware`,
`measured`). Sensitive: damping std ×1.1–2.0 of arms whose joints rub."""

ENCODER_WAVE = 0.4
"""part of a pose's repeatability by which encoders ripple within a press (1 sigma): a spring's force that is as much
off. Sensitive: damping std above 2 kN/m ×1.2–2.0."""

DAMPED = 0.1
"""part (1 sigma) of a damping: pads and their contact give way in series with the surface, and a pyramidal cone gives
up to a quarter less. Sensitive: damping std ×1.0–1.3."""

FALLING_MASS = 1.0
"""kg of the body whose rebound is stated. Sensitive: no, by definition."""

WILD = 6.0
"""standard deviations of the noise off its running median from which a sample is left out. Sensitive: no."""

RESTING_SPEED = 0.002
"""m/s below which the joints' friction begins to let go. Sensitive: stiffness hardly."""

ARM_MASS = (6.0, 3.0)
"""kg, mean and 1 sigma: apparent vertical mass at the TCP, wide enough for any seven-axis arm. Sensitive: stiffness
hardly."""

DISSIPATING_MASS = 1.0
"""kg, whose critical damping on the surface is the 1 sigma of what it dissipates. Sensitive: stiffness hardly."""

STIFFEST = 1e9
"""N/m (1 sigma) of a surface: nothing is known of it. Sensitive: no."""

WEAKEST = 1.0
"""N/m: a surface that 8 N press 8 m down is none; it keeps a compliance finite. Sensitive: no."""

SEARCHES = (25, 25, 25, 25)
"""places of the first contact that are tried in each of several rounds, the next one about the best of the last: to
a thousandth of a millimetre within 20 mm. Sensitive: no."""

RESOLVED = 1.0 / 3.0
"""part of a compliance that its standard deviation may be for a stiffness to have an upper end. Sensitive: no."""

BLOCK_ROWS = 20
"""rows, 0.1 s, of a descent over whose means white noise is small beside what else there is. Sensitive: no."""

HARDENS = 1.0 / 3.0
"""part by which a spring's stiffness may change on the way and still be one number. Sensitive: no."""

BEYOND_DOUBT = 4.0
"""standard deviations of what is certain of a spring: that it hardens somewhere, wherever that is looked for, or
flows. Sensitive: no."""

LOOKED_FOR = 3.0
"""standard deviations by which the largest of so many hardenings is off by chance. Sensitive: no."""

HINGES = 17
"""depths, every twentieth of the greatest, from which on a surface may be stiffer. Sensitive: no."""

APART = 0.05
"""m: three touches so far from one another show how a surface leans; 0.1 mm between two touches is 2 mrad.
Sensitive: no."""

LEANS_OVER = 3.3e-3
"""rad by which a contact makes the hand lean over where one finger alone stands on something. Against a level
surface an arm that nobody calibrated is out by 1.2 mrad (1 sigma: 1 mrad in each joint that turns it over, and a
base levelled to 0.5); 30 N on one finger lean it over by 4.2 mrad at 280 N m/rad. Sensitive: no."""

REACH = 0.5
"""m from the base to where an arm touches: what leans by an angle is off there by as much in height, and an arm
whose owner says that its fingertips are off by more leans by more. Sensitive: no."""

UNGAUGED = 1e-3
"""m (1 sigma) from which an arm's own height is that of one which nobody has calibrated: a datasheet states 0.2 mm,
a gauge block tells it to less than 0.1. Sensitive: no."""

EASED = 5e-4
"""m by which the hand was told to rise again where what it pressed with was eased. Sensitive: no."""

WANDERING = 100.0
"""rows of a descent per independent one of what wanders in free air: half a second, or 10 mm, over which the joints'
friction changes with the place. Sensitive: no, where noise is white."""

# Size, from grasps and touches.

OPENING = 2e-4
"""m (1 sigma): how well the fingers tell how far they are open: their drives' backlash and the pads' wear.
Sensitive: size std ×0.6–1.8."""

OPENING_HELD = 1e-3
"""m (1 sigma): how well that is an object's width once they have taken hold of it; rubber pads and what is between
them give way by so much under 50 N. Sensitive: no, where it is seen as they close."""

FIRST_SQUEEZE = 0.25
"""part of what gives way as the fingers take hold (with 50 N or so) that had given way as they met the object (with
10 N); its 1 sigma as well. Sensitive: size 0.5 σ."""

GRASPED = 0.05
"""s at the end of a grasp in which the fingers rest on what they hold. Sensitive: no."""

FIRST_MET = 0.9
"""quantile of the openings at which the fingers rested that is the first one: they rest twice for 0.1 s or more.
Sensitive: no."""

FINGERS_REST = 2e-3
"""m/s below which the fingers count as resting. Sensitive: no."""

GRASP_YIELDS = 5e-3
"""m that what is grasped gives way by at most. Sensitive: no."""

ALIGNED = 0.98
"""cosine from which two directions count as one; 11°, across which a width is 2 % wrong. Sensitive: no."""

EXTENT_PRIOR = 0.25
"""part of an extent that is its 1 sigma before measuring. Sensitive: no."""

SAME_SUPPORT = 0.05
"""m from where the scene has an object's bottom that a touched surface may be, to be what it stands on. Sensitive:
no."""

# Position, from grasps.

CENTRING = 0.0015
"""m (1 sigma): fingers centre an object on themselves as they close; in simulated grasps it ended up to 2.5 mm from
where it had stood. Sensitive: position std ×0.5–2.0."""
