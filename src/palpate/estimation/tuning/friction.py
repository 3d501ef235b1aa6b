"""Drags along a support: the numbers."""

BLOCK = 0.1
"""s: samples of a drag are averaged over blocks of this length before their scatter is taken, so correlation counts.
Sensitive: friction 0.07 σ, std ×1.0–1.1."""

DRAG_SPEED = 0.002
"""m/s, commanded and horizontal, from which a row belongs to a drag. Sensitive: no."""

SETS_OUT = 0.0005
"""m/s, commanded and horizontal, from which a hand at rest sets out. Sensitive: no."""

DRAG_SLOPE = 0.3
"""vertical over horizontal commanded speed up to which a motion is a drag. Sensitive: friction 0.7 σ, std ×0.6–1.0."""

DRAG_ROWS = 20
"""rows that a drag must exceed, so that it has a beginning and a later half. Sensitive: no."""

STEADY_ROWS = 10
"""rows of steady sliding from which a drag counts. Sensitive: no."""

CRUISE = 0.95
"""part of the usual commanded speed from which the motion is at its full speed. Sensitive: friction 1.5 σ, std
×1.0–2.0."""

SLOWING = 0.02
"""s before a motion slows down by that: jerk-limited, it has begun to. Sensitive: friction 0.2 σ."""

LATE = 0.5
"""part of a drag after which its quotient of forces is the usual one. Sensitive: friction 1.7 σ, std ×0.9–1.0."""

SLIDING = 0.85
"""part of the usual quotient of forces from which the object may be sliding: before, it turns in the fingers' grip.
Sensitive: friction 0.8 σ, std ×1.0–1.9; `static` 2.6 σ."""

FOLLOWING = 0.7
"""part of the commanded speed at which the hand follows; slower, the object may have stuck again. Sensitive: no."""

PEAK_WITHIN = 0.3
"""s after that in which the breakaway lies. Sensitive: friction 1.7 σ, std ×0.9–1.7."""

SMOOTH = 0.02
"""s: forces are averaged over this before the breakaway is looked for. Sensitive: friction 2.1 σ, std ×0.9–1.8;
`static` 1.0 σ."""

TRANSIENT = 0.25
"""s after breakaway in which the spring between arm and object still swings. Sensitive: friction 2.7 σ, std
×0.8–1.3."""

PARTED = 0.05
"""s after breakaway from which all joints together tell friction from what moves the arm's links, steadily or not.
Sensitive: 0.02 to 0.25 s change a friction by 0.2 σ, its std by ×1.0–1.05."""

DOWN = 0.006
"""m above the grasp that the hand may be while the object is on its support. Sensitive: no."""

HANGING = 0.02
"""m above the grasp from which the object hangs free. Sensitive: no."""

HORIZONTAL_MASS = 6.0
"""kg, of a 7-axis arm at its TCP, horizontally: what its acceleration at breakaway takes of the force. Sensitive:
friction 0.6 σ; `static` 1.5 σ."""

NORMAL_MIN = 0.5
"""N: below this the quotient of forces says nothing. Sensitive: no."""

FRICTION_PRIOR = 10.0
"""1 sigma of a coefficient: nothing is known of it. Sensitive: no."""

PULL = 20.0
"""N/m (1 sigma): what pulls with the place, a cable or a leash; a normal force that rises and falls shows it.
Sensitive: friction 0.1 σ."""

CURVE = 0.02
"""N (1 sigma) at `HALF_WAY`: curvature of the arm's bias along a slide. Sensitive: friction 0.2 σ, std ×0.9–1.1."""

HALF_WAY = 0.03
"""m: half of the shortest slide that a plan makes for a friction. Sensitive: friction 0.3 σ, std ×0.9–1.1."""

SAME_LINE = 0.95
"""cosine between the ways of two drags on one line. Sensitive: no."""

PRESLIDING = 2e-3
"""rad over which the friction in a joint turns round: the usual order for harmonic drives. Sensitive: `static`
hardly, std ×0.9–1.1."""

SLIPS = (4e-4, 2e-3, 1e-2)
"""rad, of the elements of which a joint's friction is a sum where a load is fitted: real arms show 1 to 4 mrad.
Sensitive: no."""

JOINT_ERROR = 0.03
"""N m (1 sigma): how well free motions show the friction behind a joint's sensor. Sensitive: friction 0.3 σ, std
×1.0–1.1."""

CORRELATED_ROWS = 20
"""rows, 0.1 s, of free motion in which what is left of a joint's torque is the same. Sensitive: hardly."""

SLOWLY = 0.5
"""rad/s²: a joint that changes its speed faster feels its inertia more than its friction. Sensitive: friction 0.2 σ."""

FREE_MOTION = 300
"""rows, 1.5 s, of motion through free air that show the friction of joints. Sensitive: no."""

UNEVEN = (0.0, 0.03, 0.1, 0.3)
"""parts (1 sigma) by which friction may differ between axes, places or speeds ... Sensitive: friction 0.07 σ, std
×0.7–1.2."""

LIKELY_UNEVEN = (0.91, 0.03, 0.03, 0.03)
"""... and how likely that is before it is felt. Sensitive: friction 0.1 σ, std ×0.8–1.2."""

ANOTHER = 0.2
"""part (1 sigma) of a joint's friction that is another where things are dragged. Sensitive: friction 0.1 σ, std
×0.9–1.1."""

ANOTHER_DRAG = 0.1
"""part (1 sigma) of it that is another in every drag. Sensitive: friction 0.1 σ, std ×0.9–1.1."""

DRAG_BIAS = 0.01
"""N (1 sigma) of a drag's own. Sensitive: hardly."""

HELD = 0.1
"""N (1 sigma) that hold an object, however hard it is pressed. Sensitive: friction 0.2 σ."""

HOLDING_MORE = (0.0, 1.0, 10.0)
"""times `HELD` that it may be, where the arm's own forces are known ... Sensitive: friction 0.5 σ, std ×0.5–1.1."""

LIKELY_HOLDING = (0.9, 0.08, 0.02)
"""... and how likely each is before it is felt. Dry friction is in proportion to pressure (Amontons); one thing in
ten is taken to cling. Chosen, without a source. Sensitive: friction 0.5 σ, std ×0.9–1.9."""

LIKELY_PULL = (0.9, 0.1)
"""how likely nothing pulls with the place, and something does, where the arm's own forces are known. Chosen, without
a source, as `LIKELY_HOLDING`. Sensitive: no at 0.95 (`lab`)."""

LEANING = (0.2, 1.0)
"""times `LEAN` that a support may be out of level ... Sensitive: friction std ×0.85 or so without it."""

LIKELY_LEANING = (0.7, 0.3)
"""... and how likely each is before it is felt: arms stand on what was levelled with a spirit level, to 1 mm/m, or
on what stands on a floor. Chosen, without a source. Sensitive: hardly."""

STEP = 0.1
"""N m (1 sigma) that a sensor's zero may be another after the drags where it jumped, and from which a model without
a jump does not hold: a jump of 1 N at the hand is 0.2 to 0.24, of all joints. Sensitive: no."""

LIKELY_STEP = (0.9, 0.1)
"""how likely none has, and some have. Chosen, without a source. Sensitive: no."""

FRICTION_RANGE = 1.0
"""1 sigma by which a coefficient may differ where it does. Sensitive: no."""

HELD_RANGE = 10.0
"""N (1 sigma) that hold an object where something does. Sensitive: no."""

FRICTION_ITERATIONS = 2
"""solutions: what gains and joints do depends on the coefficient. Sensitive: no."""

WHOLE_ITERATIONS = 3
"""solutions of the fit to all motion: the first is up to two deviations from the last where the coefficient that it
begins with is 15 % off. Sensitive: no from 3 on (0.1 σ)."""

CORRELATED_BLOCKS = 3.0
"""blocks: what the model of a drag leaves out is the same in about so many neighbouring ones. Sensitive: friction
std ×0.8–1.3."""

SLIDING_NOISE = 1e-3
"""N: noise of a block that is always assumed. Sensitive: no."""

HORIZONTAL_SPREAD = 4.0
"""kg (1 sigma) of `HORIZONTAL_MASS`: towards the base and away from it an arm seems to have twice the mass that it
has to the side. Sensitive: `static` hardly."""

STILL_SLIDING = 0.4
"""part of its speed to which a hand has slowed down while the object is sure to slide. Sensitive: `static` hardly."""

MASS_ERROR = 0.5
"""kg (1 sigma) at least, of what the end of a drag shows of the arm's mass: it slows down along other joint angles
than it set out with. Chosen, without a source: a tenth of `HORIZONTAL_MASS`, rounded. Sensitive: `static` std."""

STRAINING = 0.1
"""s before a hand is told to set out, from which a drag is looked at: what was strained before breaks away at once.
Sensitive: no."""

HOLDING = 6
"""rows, 30 ms, for which an object holds at the coefficient of sticking and creeps before it lets go, at most.
Sensitive: `static` hardly."""

PARTING_ROWS = 7
"""rows, 35 ms, before it lets go, in which an object holds or the force rises to that in a straight line: the hand
sets out with a jerk, so that for longer it does not. Sensitive: `static` 0.5 σ."""

RISING = 0.25
"""part (1 sigma) of the coefficient by which the force rises in a row. Sensitive: `static` hardly."""

STATIC_STEPS = 200
"""values of a coefficient of sticking that are tried, from that of sliding ... Sensitive: no."""

STATIC_RANGE = 2.5
"""... to so many times it: wider than the pairs of dry surfaces that handbooks list (mostly 1.0 to 1.5). Sensitive:
`static` hardly."""

STICKIER = 0.3
"""part by which things stick better than they slide, usually: steel on steel 0.74 and 0.57, copper on steel 0.53 and
0.36, rubber on concrete 1.0 and 0.8 (tables of textbooks, e.g. Serway, Physics for Scientists and Engineers, table
5.1) ... Sensitive: `static` hardly."""

STICKIER_FACTOR = 2.5
"""... by so many times more or less (1 sigma). Sensitive: `static` hardly."""

TURNING = 0.5
"""part (1 sigma), that is not known, of what joints that turn round rub less than they will: over how many mrad they
do, `PRESLIDING`, is known to a factor of two or so. Sensitive: `static` std ×0.8 at 0 where joints rub by 0.4 N m."""

STATIC_NOISE = 0.005
"""noise of a row's quotient of forces that is always assumed: what rises does not rise in a straight line.
Sensitive: `static` hardly."""

PARTINGS_SEEN = 0.5
"""part of what is not known of static friction before, from which breakaways say something of it. Sensitive: no."""

STICKING = 0.1
"""part of the rows of steady sliding in which the hand may lag behind its command; an object that sticks and slips
holds it back most of the time. Sensitive: no."""

ROUGH = 10.0
"""times the noise that is expected of a drag, from which it is chatter. Sensitive: no."""

NEARLY_ROUGH = 2.5
"""likewise, from which a drag counts only where it is steady: few of them do, but for chatter. Sensitive: friction
no from 1.5 to 3; without it, one that nearly chattered read 0.08 too little, 5 standard deviations; with it 0.20,
where 0.21 is stated."""

SMOOTH_NOISE = 0.03
"""N², of a row: noise that moving adds to that at rest, of ripples in gears and encoders: 0.04 N in means of 0.1 s.
Sensitive: no."""

LIKELY_FRICTION = 2.0
"""coefficient beyond which nothing dry slides on anything. Sensitive: no."""

SIGNIFICANT = 2.0
"""standard deviations from zero from which a friction is identified. Sensitive: no."""

ALIKE_FRICTION = 0.05
"""part (1 sigma) of a coefficient by which it may differ between directions, places and speeds and still be one.
Sensitive: no."""

SLOW = 0.08
"""m/s below which the arm's own motion leaves little in its torques. Sensitive: friction 0.3 σ, std ×0.9–1.2."""

LEAN = 0.005
"""rad (1 sigma): how far a support is out of level; floors may be by 3 mm/m (DIN 18202, quoted from memory), and
tables stand on them. Sensitive: friction 0.3 σ, std ×0.8–1.2."""

REFERRED = 0.2
"""N (1 sigma): bias of a force on the support that is referred to one some cm above: what the model of the arm's
links leaves, half a per cent of some 40 N m at levers of half a metre, changes by a fifth or so. Sensitive: friction
0.1 σ, std ×0.9–1.2."""
