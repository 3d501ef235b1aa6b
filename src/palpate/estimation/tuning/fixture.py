"""Tuning numbers of the joints of drawers, doors and windows."""

HANDLE_BLOCK = 0.2
"""s over whose mean the force along a joint is fitted: two of them fit into the ramps of a pass."""

HANDLE_MOVES = 0.004
"""m/s of the handle below which it counts as standing still: pads and springs give way before dry friction is full."""

HANDLE_SETS_OUT = 0.003
"""m from where a pass began, in which the friction of joints, pads and rails turns round and no block counts."""

HANDLE_FORCE = 50.0
"""N (1 sigma): prior of forces at a handle: dry friction, the pull of gravity or of a spring. Says nothing."""

HANDLE_VISCOUS = 200.0
"""N s/m (1 sigma): prior of a damping at the handle. Says nothing."""

HANDLE_STIFFNESS = 500.0
"""N/m (1 sigma): prior of a stiffness at the handle. Says nothing."""

HANDLE_MASS = 20.0
"""kg (1 sigma): prior of the mass that is felt at the handle. Says nothing."""

HANDLE_DRIFT = 20.0
"""N per m (1 sigma): by which the force of the arm alone changes along a way beyond what its joints' friction makes,
as `vocabulary.touch.DRIFT`."""

HANDLE_LOADED = (0.1, 0.05)
"""parts (1 sigma) of the friction of the arm's joints by which it may be another with the handle in the hand than at
the empty hand's pose: at any speed, and more or less of it at the highest. Chosen: without the second, damping was
1.7 (rms) of its deviation off in four worlds at `measured`."""

HANDLE_EVEN = 0.1
"""N at the handle by which friction may differ along the way, or at higher speed, as a test tolerates, ..."""

HANDLE_UNEVEN = 0.05
"""... and part of the whole friction, likewise."""

LIMIT_SMOOTH = 5
"""rows, 25 ms, over whose mean the force at a limit is taken."""

LIMIT_PRESSED = 15.0
"""N: a force that is smaller shows no limit."""

LIMIT_BEFORE = 2.0
"""s before the largest force in which the force of moving is looked for."""

LIMIT_NEAR = 0.008
"""m before the farthest point that is no longer moving freely: a stop and an arm give way by some millimetres."""

LIMIT_SHARE = 0.2
"""part of the rise of the force from which it counts as rising: pads and rails give way before."""

LIMIT_ALIKE = 10.0
"""rows that err alike."""

LIMIT_FOOT = 2e-4
"""m (1 sigma): by which pads and rails give way before a limit bears; in the simulation 0.1 to 0.2 mm."""

LIMIT_SOFT = 0.05
"""part (1 sigma) of the way from limit to standstill by which a stop's loading curve may be no straight line."""

LIMIT_ALL = 0.95
"""part of the largest force at which the loading of a limit ends."""
