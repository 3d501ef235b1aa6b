"""Tuning numbers of segmentation, sensor noise and the load."""

# Segmentation of a trace into rests and passes.

SETTLE = 0.15
"""s after the commanded pose stopped moving: the impedance controller's transient. Sensitive: mass 0.1 σ; friction
0.2 σ, std ×1.0–1.1; com 0.2 σ."""

START = 0.06
"""s before the commanded pose moves on: a smooth start accelerates before it visibly moves. Sensitive: com 0.08 σ,
std ×0.9–1.0."""

STILL_SPEED = 0.001
"""m/s: below this the TCP counts as at rest. Sensitive: mass 0.1 σ; friction 0.2 σ, std ×1.0–1.1; com 0.2 σ."""

STILL_TURN = 0.01
"""rad/s: likewise, of the hand's turning. Sensitive: no."""

NEAR = 0.012
"""m off the measured pose that a rest may be and still count as the same pose (a loaded arm sags by m g / k).
Sensitive: no."""

NEAR_ANGLE = 0.06
"""rad off the measured orientation, likewise. Sensitive: no."""

CORRIDOR = 0.02
"""m beside the line from the grasp to the measured pose that a pass may run. Sensitive: mass 0.7 σ, std ×1.0–1.3."""

CLEARANCE = 0.015
"""m of the path above the grasp left out: there the support may still carry part of the object. Sensitive: mass 0.7
σ, std ×0.9–1.1; com 0.2 σ, std ×0.8–1.4."""

SHORT_LIFT = 0.4
"""part of the path left out instead where the lift is short. Sensitive: no."""

COVERED = 0.4
"""part of the lift that a pass must cover, so that all passes have bins in common. Sensitive: mass 1.5 σ, std
×1.0–1.5."""

LIFT_MIN = 0.02
"""m: a lift shorter than this is no path to compare passes on. Sensitive: no."""

REST_ROWS = 5
"""rows at least that make a rest, so that their mean has a scatter. Sensitive: mass 0.08 σ."""

ARRIVAL = 0.02
"""m: last stretch before a rest, whose direction determines the friction in the joints. Sensitive: no."""

ALONG = 0.7
"""cosine between that stretch and the path from which the rest was reached along the path. Sensitive: mass 0.2 σ,
std ×0.9–1.0."""

PASS_SPEED = 0.01
"""m/s along the path from which the joints certainly slide. Sensitive: mass 0.2 σ, std ×0.9–1.1; com 0.1 σ, std
×1.0–1.1."""

ALIKE_SPEED = 0.5
"""part of the speed of the slowest pass, from which noise in motion counts as that of the passes. Chosen: it keeps the
ramps of passes, and leaves out descents of a tenth of their speed. Sensitive: mass std ×1.0–1.3 at 0.3, no at 0.8."""

FOLLOWED = 0.1
"""s over which speeds and torques are averaged: between 8 and 30 Hz the torque of a real arm does not follow its links'
motion, as gears, encoders and controller ripple and resonate. Sensitive: mass std ×1.05 at `lab`; on a recorded FR3 it
halves it; with 0.02 s in a lift the ripple of encoders reads as −2.5 N/m along it at `measured`."""

SPEED_SMOOTH = 0.05
"""s over which the speed is averaged for the test of a constant speed: encoders are noisy. Sensitive: mass 0.5 σ,
std ×0.9–1.5."""

STEADY = 0.05
"""m/s², up to which a row belongs to a pass: the inertial force of the arm as it changes its speed is far more than
a load. Sensitive: mass 0.7 σ, std ×0.8–1.5."""

SAME_MOTION = 0.25
"""m/s², root mean square along the path: passes whose accelerations differ by more are not compared. Sensitive: no."""

BINS = 10
"""bins along the path, so that all passes are compared at the same configurations. Sensitive: mass 0.3 σ."""

# Noise of the joint sensors.

SHORT_BLOCK = 0.05
"""s: means over such blocks show the white noise; longer than the memory of a filter of the signals. Sensitive: mass
0.2 σ, std ×0.9–1.2."""

LONG_BLOCK = 0.25
"""s: means over such blocks show slower noise; some of them fit into the shortest pass. Sensitive: mass 0.3 σ, std
×0.8–1.5."""

SMOOTH_DEGREE = 2
"""degree of the polynomial in time that is no noise of a stretch. Sensitive: mass 0.1 σ, std ×0.9–1.2."""

FLICKER_SPAN = 4.0
"""s for which white noise is averaged in a pass, to compare it with what is slower. Sensitive: no."""

FLICKER_FREEDOM = (6.0, 20.0)
"""degrees of freedom that the level of 1/f noise has at least and at most, between which the number of blocks of
`LONG_BLOCK` decides: where it hardly exceeds white noise it is known to a factor of two or so; where many blocks
show it, it is still extrapolated to a run of some ten seconds (in 75 recorded runs with a known level its square
came out at 0.7 to 1.25 of that). Sensitive: 95 % intervals ×0.9–1, no std."""

GAP = 3.0
"""sampling periods from which samples are missing. Sensitive: no."""

STANDS_OUT = 2.0
"""standard deviations of the excess scatter of long blocks over white noise from which it counts as 1/f noise.
Sensitive: mass 0.2 σ, std ×0.8–1.2."""

OVERLAP = 2.0
"""second differences of neighbouring blocks per independent one. Sensitive: mass 0.1 σ, std ×0.9–1.1."""

# Load from the contrast of rests and passes, and from all free motion.

CHAIN_ROWS = 20
"""rows on which the arm's kinematics must reproduce the wrench. Sensitive: no."""

CHAIN_FORCE = 0.5
"""N, median over those rows: where they differ by more, the wrench itself is taken. Sensitive: no."""

CENTRIFUGAL = 8.0
"""N s²/m² (1 sigma): force by the square of the speed; equal motions compare best. Sensitive: hardly."""

DEGREE = 3
"""degree of the polynomial along the path that the bias of one direction of travel follows. Sensitive: mass 0.2 σ."""

DRIFT = 0.033
"""N (1 sigma): drift of the sensors' zero; 0.01 N m in a joint. No published figure: some 0.2 permille of the range
of a large joint's strain gauges. Sensitive: mass 0.3 σ, std ×1.0–1.1."""

DRIFT_TIME = 300.0
"""correlation time of that drift, s. No published figure. Sensitive: mass 0.15 σ."""

FLICKER_TIMES = tuple(0.3 * 4.0**i for i in range(6))
"""s: time constants of the processes whose sum is 1/f noise; from what blocks see to the length of a long run.
Sensitive: hardly."""

APPARENT_MASS = 10.0
"""kg (1 sigma): apparent vertical mass at the TCP of an arm whose links are not known, wide enough for any with
seven axes. Sensitive: mass 0.1 σ."""

INERTIA_DEGREE = 1
"""degree of the polynomial along the path that the arm's apparent mass follows. Sensitive: hardly."""

UNSTEADY = 0.15
"""kg (1 sigma), times the acceleration: unknown force while the speed changes, bin by bin, where links are not
known; some per cent of the arm's apparent mass. Sensitive: no, where passes are steady."""

INERTIA_SHARE = 0.05
"""unknown part (1 sigma) of the torques that move the arm's links: identified models are some per cent off (Gaz et
al., as below). Sensitive: mass 0.2 σ where signals wander, else no."""

INERTIA_OFF = ((1.0, 10.0), (0.9, 0.1))
"""factors on that where all free motion is fitted, with prior probabilities: of a real arm's wrist, whose motors are
much of what it moves, half of it was missing. Sensitive: no."""

UNSTEADY_SHARE = 0.01
"""likewise, bin by bin: links and gears bend a little. Sensitive: mass 0.2 σ, std ×0.95–1.1."""

VISCOUS = 1.0
"""N s/m (1 sigma): force by the speed; friction of 0.07 N m s/rad at a lever of half a metre is a third of it.
Sensitive: hardly."""

BIN_BIAS = 0.03
"""N (1 sigma): residual of the polynomial bias at one place of the path (gear ripple). Sensitive: mass 0.08 σ."""

REST_FRICTION = 0.1
"""N (1 sigma): friction that differs between rests after the same approach. Sensitive: mass 0.08 σ."""

LEFT_SHARES = (1.0 / 64.0, 1.0 / 8.0, 1.0)
"""parts of the datasheet's `force_repeatability` that an approach may leave in the joints of this very arm, and
parts of that which stay while they move, as forces at the hand and in each joint: from next to nothing to all of it,
each as likely before anything is recorded. Sensitive: mass std ×0.9–1.2."""

KINDS_APART = (1.0, 1.0 / 8.0, 1.0 / 64.0)
"""parts (1 sigma) of `KIND_BIAS`, `BIN_BIAS` and `REST_FRICTION` that each kind of segment has of its own: from all
of it, unless the evidence against that is very strong, to next to nothing. Sensitive: mass 0.3 σ, std ×0.9–1.0 where
joints hardly rub."""

VERY_STRONG = 5.0
"""logarithm of a Bayes factor from which evidence is very strong (Kass and Raftery, Journal of the American
Statistical Association 90, 1995, section 3.2: 150). Sensitive: no."""

COUNTED = 1e-4
"""probability from which a combination of hyperpriors is averaged over. Sensitive: no."""

GAINS_OFF = ((1.0, 3.0), (0.95, 0.05))
"""factors on the datasheet's uncertainty of gains, with prior probabilities: one arm in twenty is no longer as it
was delivered. Sensitive: no."""

CROSSTALK = 0.25
"""error (1 sigma) by the torques of other joints, in those of a gain: 0.14 % where gains are known to ±1 %. Bending is
read as torsion: 0.43 N m of 54 N m in an uncalibrated sensor that was designed for little of it (Design and
Optimization of a Joint Torque Sensor with Small Crosstalk Error for Robots, econbiz.de/Record/10013300597). Sensitive:
mass above 1 kg std ×1.02–1.08 at `measured`."""

PULL_SMALL = 0.05
"""N/m (1 sigma): tolerated growth of a force with the height. Sensitive: no."""

PULL_SHARE = 0.03
"""1/m (1 sigma), part of the load: likewise; levers of joints are not known better along a lift, and loads in a
perfect world read up to 5 % a metre off. Sensitive: no."""

RUB_SHARE = 0.002
"""part of the load (1 sigma), likewise: friction in a joint grows with what it bears by about so much. Sensitive:
no."""

RUB_SMALL = 0.005
"""N (1 sigma): tolerated difference of a load between directions, between rest and pass and between weighings: a
tenth of the force that such arms resolve. Sensitive: no."""

TELLING = 0.1
"""part of `LOAD_PRIOR`: a term with a larger std cannot be separated from the load. Sensitive: no."""

LOAD_ITERATIONS = 3
"""solutions after the first: effects of gains and tilts are in proportion to the load. Sensitive: no."""

LOAD_PRIOR = 1e3
"""N (1 sigma) of the load: nothing is known of it. Sensitive: no."""

JOINT_LEVEL = 0.3
"""N m (1 sigma) of the friction in a joint, behind its sensor: 0.15 to 0.64 were identified (Gaz et al., RA-L 2019,
doi:10.1109/LRA.2019.2931248). Sensitive: com 0.1 σ, std ×0.9–1.1."""

ENCODER_PLAY = 1e-5
"""rad of play, below which a change of a joint angle is encoder noise. Sensitive: no."""

RUBBING_ROWS = 4
"""rows, 20 ms, over whose mean angles a joint's motion is followed. Sensitive: no."""

FORESEEN_DRAWS = 2
"""draws of noise for the prediction of planned passes. Sensitive: no, it decides on work alone."""

HANDLING = 1.0
"""s between two planned passes: the arm settles, the fingers close or open. Sensitive: robot time alone, by as much
a pass."""

WHOLE_BLOCK = 0.1
"""s of a block of a whole run: white noise averages out and nothing moves far. Sensitive: no."""

WHOLE_MOST = 400
"""such blocks at most; longer runs have longer ones. Sensitive: no."""

WHOLE_AROUND = 15.0
"""s before and after an object hung on the hand, in which motions of the empty hand are used. Sensitive: mass 0.1 σ."""

WHOLE_SLOW = 0.02
"""rad/s of all joints together: slower than that, an arm is about to rest. Sensitive: no."""

WHOLE_SHAKEN = 0.01
"""rad, likewise, after which residual stiction of a rest and reversing friction have decayed: five times
`PRESLIDING`. Sensitive: mass 0.1 σ."""

WHOLE_SETTLED = 0.3
"""s after which the residual stiction of an approach has built up. Sensitive: no; without it rests leave a misfit
where they stick."""

WHOLE_NEAR = 0.03
"""m from the place of a load, within which motions of the empty hand certainly count: on its way home, in a turn of
all joints, a model of the arm is off by some mN m. Sensitive: mass 0.3–0.6 σ at 0.1 to 0.2, to one side."""

WHOLE_APART = 3.0
"""largest difference of such a model from the contrast, in standard deviations of the contrast. Sensitive: no."""

LOAD_INERTIA = 0.01
"""kg m² (1 sigma) of a load about the TCP, which shows where the hand turns unevenly: 1 kg at 0.1 m. Sensitive: no."""

ANY_ZERO = 10.0
"""N m (1 sigma): uninformative prior of a sensor's zero. Sensitive: no."""

JOINT_VISCOUS = 0.3
"""N m s/rad (1 sigma): friction in a joint that grows with its speed; 0.07 was identified (Gaz et al., as above).
Sensitive: hardly."""

LINK_MASS = 0.05
"""relative error (1 sigma) of the mass that moves with a joint; identified models are some per cent off (Gaz et al.,
as above). Sensitive: hardly."""

LINK_CENTRE = 5e-3
"""m (1 sigma), error of its centre of mass. No published figure. Sensitive: hardly."""

FREE_ABOVE = 5e-3
"""m above the grasp, from which an object is in free air. Sensitive: no."""

# Coloured residual.

SLIPS_OTHERWISE = ((0.1, 1.0), (0.7, 0.3))
"""factors on the friction of elements whose presliding is not the usual one, with prior probabilities. Chosen,
without a source. Sensitive: mass std ×1.08 where they always count."""

COLOUR_TIMES = (0.03, 0.3, 1.0, 4.0, 30.0)
"""s over which what a model leaves stays alike: from one block to a run. Sensitive: hardly."""

COLOUR_PATHS = (0.003, 0.01, 0.1)
"""rad over which it does as the joint turns: of gears' ripple and of a lift. Sensitive: no."""

COLOUR_START = 0.02
"""N m (1 sigma) of each process, from which the recording's own is sought. Sensitive: no."""

COLOUR_ROUNDS = 6
"""rounds of that; each brings a variance nearer to its likeliest. Sensitive: no."""

COLOUR_CHANCE = 3.0
"""logarithm of how much likelier the rows have to be with the processes than without, to count by half: one for each
two of the seven. Sensitive: mass std ×1.0–1.1 at `lab`."""

COLOUR_FREEDOM = 4.0
"""degrees of freedom that its variance has at least. Sensitive: no."""

DIFFUSE = 30.0
"""N, N m (1 sigma) of an unknown with no prior, as the size of a residual is learned. Sensitive: no."""

EMPTY_BLOCKS = 20
"""blocks, 2 s, of motion with an empty hand from which they show what the model of the arm leaves. Sensitive: no."""
