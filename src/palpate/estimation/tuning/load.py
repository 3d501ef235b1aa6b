"""The load from the contrast of rests and passes: the numbers."""

CHAIN_ROWS = 20
"""rows on which it is tried whether an arm's kinematics explain its wrench. Sensitive: no."""

CHAIN_FORCE = 0.5
"""N, median over those rows: where they differ by more, the wrench itself is taken. Sensitive:
no."""

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
"""kg (1 sigma): apparent vertical mass at the TCP of an arm whose links are not known, wide enough for
any with seven axes. Sensitive: mass 0.1 σ."""

INERTIA_DEGREE = 1
"""degree of the polynomial along the path that the arm's apparent mass follows. Sensitive:
hardly."""

UNSTEADY = 0.15
"""kg (1 sigma), times the acceleration: what is not known of a force while the speed changes, bin
by bin, where links are not known; some per cent of the arm's apparent mass. Sensitive: no, where
passes are steady."""

INERTIA_SHARE = 0.05
"""part (1 sigma), that is not known, of what moving the arm's links takes: identified models leave some
per cent (Gaz et al., as below). Sensitive: mass 0.2 σ where signals wander, else no."""

UNSTEADY_SHARE = 0.01
"""likewise, bin by bin: links and gears bend a little. Sensitive: mass 0.2 σ, std ×0.95–1.1."""

VISCOUS = 1.0
"""N s/m (1 sigma): what the speed makes of a force; friction of 0.07 N m s/rad at a lever of half a
metre is a third of it. Sensitive: hardly."""

BIN_BIAS = 0.03
"""N (1 sigma): what the polynomial leaves of the bias at one place of the path (gear waves).
Sensitive: mass 0.08 σ."""

REST_FRICTION = 0.1
"""N (1 sigma): friction that is another at every rest, though the arm came the same way. Sensitive:
mass 0.08 σ."""

LEFT_SHARES = (1.0 / 64.0, 1.0 / 8.0, 1.0)
"""parts of the datasheet's `force_repeatability` that an approach may leave in the joints of this very
arm, and parts of that which stay while they move, as forces at the hand and in each joint: from next
to nothing to all of it, each as likely before anything is recorded. Sensitive: mass std ×0.9–1.2."""

KINDS_APART = (1.0, 1.0 / 8.0, 1.0 / 64.0)
"""parts (1 sigma) of `KIND_BIAS`, `BIN_BIAS` and `REST_FRICTION` that each kind of segment has of its own:
of all of it, as long as nothing speaks very strongly against that, to next to nothing. Sensitive: mass
0.3 σ, std ×0.9–1.0 where joints hardly rub."""

VERY_STRONG = 5.0
"""logarithm of a Bayes factor from which evidence is very strong (Kass and Raftery, Journal of the American
Statistical Association 90, 1995, section 3.2: 150). Sensitive: no."""

COUNTED = 1e-4
"""Probability from which a choice of what is unsure is averaged over. Sensitive: no."""

GAINS_OFF = ((1.0, 3.0), (0.95, 0.05))
"""by how much more than the datasheet says gains may be off, and how likely each is before anything is
recorded: one arm in twenty is not what it was when it was delivered. Sensitive: no."""

PULL_SMALL = 0.05
"""N/m (1 sigma): a force that grows with the height so little is no contradiction. Sensitive:
no."""

PULL_SHARE = 0.03
"""1/m (1 sigma), part of the load: likewise; levers of joints are not known better along a lift,
and loads in a perfect world read up to 5 % a metre off. Sensitive: no."""

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

LOAD_PRIOR = 1e3
"""N (1 sigma) of the load: nothing is known of it. Sensitive: no."""

JOINT_LEVEL = 0.3
"""N m (1 sigma) of the friction in a joint, behind its sensor: 0.15 to 0.64 were identified (Gaz et
al., RA-L 2019, doi:10.1109/LRA.2019.2931248). Sensitive: com 0.1 σ, std ×0.9–1.1."""

ENCODER_PLAY = 1e-5
"""rad that a joint must turn to have turned: encoders are noisy. Sensitive: no."""

RUBBING_ROWS = 4
"""rows, 20 ms, over whose mean angles a joint's motion is followed. Sensitive: no."""

FORESEEN_DRAWS = 2
"""draws of noise that passes to come are judged by. Sensitive: no, it decides on work alone."""

HANDLING = 1.0
"""s between two passes, as foreseen: the arm settles and feels what it bears, the fingers take or
let go. Sensitive: robot time alone, by as much a pass."""

WHOLE_BLOCK = 0.1
"""s of a block of a whole run: white noise averages out and nothing moves far. Sensitive: no."""

WHOLE_MOST = 400
"""such blocks at most; longer runs have longer ones. Sensitive: no."""

WHOLE_AROUND = 15.0
"""s before and after an object hung on the hand, in which the empty hand tells of the arm. Sensitive:
mass 0.1 σ."""

WHOLE_SLOW = 0.02
"""rad/s of all joints together: slower than that, an arm is about to rest. Sensitive: no."""

WHOLE_SHAKEN = 0.01
"""rad, likewise, after which what a rest left in the joints, and friction that turns round, are gone: five
times `PRESLIDING`. Sensitive: mass 0.1 σ."""

WHOLE_SETTLED = 0.3
"""s after which what an approach leaves in the joints has built up. Sensitive: no; without it
rests leave a misfit where they stick."""

WHOLE_NEAR = 0.03
"""m from where a load hung, within which the empty hand surely tells of the arm there: on its way home, in
a turn of all joints, a model of it is off by some mN m. Sensitive: mass 0.3–0.6 σ at 0.1 to 0.2, to one side."""

WHOLE_MISFIT = 1.1
"""mean square of what a model of all that an arm did leaves, in units of the noise, up to which nothing
else acts: some 1500 rows scatter by 0.04 about 1 or less. Sensitive: no; arms whose friction changes with the
place, or in which rests leave something, leave 1.2 to 2.5."""

WHOLE_APART = 3.0
"""standard deviations of a contrast by which such a model may differ from it. Sensitive: no."""

ANY_ZERO = 10.0
"""N m (1 sigma): a sensor's zero, of which nothing is known. Sensitive: no."""

JOINT_VISCOUS = 0.3
"""N m s/rad (1 sigma): friction in a joint that grows with its speed; 0.07 was identified (Gaz et al., as
above). Sensitive: hardly."""

LINK_MASS = 0.05
"""part (1 sigma) that what moves with a joint is heavier than it is said to be; identified models leave some per
cent (Gaz et al., as above). Sensitive: hardly."""

LINK_CENTRE = 5e-3
"""m (1 sigma) by which its centre lies elsewhere. No published figure. Sensitive: hardly."""

FREE_ABOVE = 5e-3
"""m above where it was grasped, a thing touches nothing any more. Sensitive: no."""
