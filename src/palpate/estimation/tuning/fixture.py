"""Tuning numbers of the joints of drawers, doors and windows."""

HANDLE_BLOCK = 0.2
"""s over whose mean the force along a joint is fitted: two of them fit into the ramps of a pass.
Sensitive: dry friction and damping 1.8 σ at half of it, 2.7 σ at twice; two blocks have to fit into the shortest
ramp."""

HANDLE_MOVES = 0.004
"""m/s of the handle below which it counts as standing still: pads and springs give way before dry friction is full.
Sensitive: 0.5 σ; slower blocks carry less than the full dry friction."""

HANDLE_SETS_OUT = 0.003
"""m from where a pass began, in which the friction of joints, pads and rails turns round and no block counts.
Sensitive: dry friction 1.4 σ, damping 2.2 σ; shorter, and friction that still turns round counts as dry friction."""

HANDLE_ONSET = (0.004, 0.015, 0.019, 0.023, 0.028, 0.034, 0.041, 0.05)
"""m/s of the handle from which dry friction is full: MuJoCo's is from about 0.001 m/s times its size over the moving
mass (N/kg) on, and grease does the same. Sensitive: with the first alone, the friction of a door of 0.6 kg came out
40 % low, contradicted."""

HANDLE_FORCE = 50.0
"""N (1 sigma): prior of forces at a handle: dry friction, the pull of gravity or of a spring. Says nothing.
Sensitive: no, it is wider than any handle's force."""

HANDLE_VISCOUS = 200.0
"""N s/m (1 sigma): prior of a damping at the handle. Says nothing.
Sensitive: no, it is wider than any rail's."""

HANDLE_STIFFNESS = 500.0
"""N/m (1 sigma): prior of a stiffness at the handle. Says nothing.
Sensitive: no, it is wider than any door closer's."""

HANDLE_MASS = 20.0
"""kg (1 sigma): prior of the mass that is felt at the handle. Says nothing.
Sensitive: no, it is heavier than what an arm moves."""

HANDLE_DRIFT = 20.0
"""N per m (1 sigma): by which the force of the arm alone changes along a way beyond what its joints' friction makes,
as `vocabulary.touch.DRIFT`.
Sensitive: no, friction and damping do not move."""

HANDLE_ELSEWHERE = 0.2
"""part of that (1 sigma) by which it differs between the handle and above it. Sensitive: it is most of a spring's std,
which is that of the whole drift where it is 1."""

HANDLE_LOADED = (0.1, 0.07)
"""parts (1 sigma) of the friction of the arm's joints by which it may be another with the handle in the hand than at
the empty hand's pose: at any speed, and more or less of it at the highest. Chosen: in 32 drawers at `measured` the
damping is 0.96 (rms) of its deviation off, with 0.05 for the second 1.11; in 60 doors at three noise levels
less. Sensitive: std of dry friction ×0.6–1.0 at half of both, of damping ×0.6–0.8; values move by less than 0.1 σ."""

HANDLE_EVEN = 0.1
"""N at the handle by which friction may differ along the way, or at higher speed, as a test tolerates.
Sensitive: it decides the test of even friction alone."""

HANDLE_UNEVEN = 0.05
"""part of the whole friction, likewise.
Sensitive: it decides the test of even friction alone."""

LIMIT_SMOOTH = 5
"""rows, 25 ms, over whose mean the force at a limit is taken.
Sensitive: not tried."""

LIMIT_PRESSED = 15.0
"""N: a force that is smaller shows no limit.
Sensitive: no, limits are pressed with 30 N."""

LIMIT_BEFORE = 2.0
"""s before the largest force in which the force of moving is looked for.
Sensitive: not tried."""

LIMIT_NEAR = 0.008
"""m before the farthest point that is no longer moving freely: a stop and an arm give way by some millimetres.
Sensitive: not tried."""

LIMIT_SHARE = 0.2
"""part of the rise of the force from which it counts as rising: pads and rails give way before.
Sensitive: not tried; a lower one reads noise as the foot of the curve."""

LIMIT_ALIKE = 10.0
"""rows of a loading curve that err alike, as neighbours do.
Sensitive: the deviation of a limit by noise is proportional to its root."""

LIMIT_FOOT = 2e-4
"""m (1 sigma): by which pads and rails give way before a limit bears; in the simulation 0.1 to 0.2 mm.
Sensitive: at `lab` it is most of a limit's deviation."""

LIMIT_SCALE = 0.8
"""part (1 sigma) of the angle by which an arm may be out that its way to a limit is too long or short: at `measured`,
of 0.22 m, 0.6 mm (root mean square of seven arms).
Sensitive: limit std ×1.0–2.5 at `measured`, not at `lab`."""

LIMIT_SOFT = 0.05
"""part (1 sigma) of the way from limit to standstill by which a stop's loading curve may be no straight line.
Sensitive: not tried."""

LIMIT_ALL = 0.95
"""part of the largest force at which the loading of a limit ends.
Sensitive: not tried."""

HANDLE_LEVEL = 0.02
"""Cosine between the vertical and the way of a slide, or the horizontal and the axis of a hinge, below which
gravity does not depend on the position. Sensitive: no, 0.02 of a weight is less than friction's deviation."""

HANDLE_RATE = 0.05
"""s over which speeds, torques and the motion of the arm's links are averaged, all alike: averaged otherwise, their
differences in ramps are taken for inertia and damping. Sensitive: at twice it dry friction 0.3 σ, damping 0.3 σ."""
