"""Cutting a trace into rests and passes: the numbers."""

SETTLE = 0.15
"""s after the commanded pose stopped moving: the impedance controller's transient. Sensitive: mass
0.1 σ; friction 0.2 σ, std ×1.0–1.1; com 0.2 σ."""

START = 0.06
"""s before the commanded pose moves on: a smooth start accelerates before it visibly moves.
Sensitive: com 0.08 σ, std ×0.9–1.0."""

STILL_SPEED = 0.001
"""m/s: below this the TCP counts as at rest. Sensitive: mass 0.1 σ; friction 0.2 σ, std
×1.0–1.1; com 0.2 σ."""

STILL_TURN = 0.01
"""rad/s: likewise, of the hand's turning. Sensitive: no."""

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

SPEED_SHORT = 0.02
"""s over which the speed is averaged before an acceleration is taken for what the arm's inertia
felt. Sensitive: mass 0.3 σ."""

SPEED_SMOOTH = 0.05
"""s over which the speed is averaged before it is asked whether the arm goes steadily: encoders are
noisy. Sensitive: mass 0.5 σ, std ×0.9–1.5."""

STEADY = 0.05
"""m/s², up to which a row belongs to a pass: what the arm's own inertia does as it changes its
speed is far more than a load. Sensitive: mass 0.7 σ, std ×0.8–1.5."""

SAME_MOTION = 0.25
"""m/s², root mean square along the path: passes whose accelerations differ by more are not
compared. Sensitive: no."""

BINS = 10
"""bins along the path, so that all passes are compared at the same configurations. Sensitive: mass
0.3 σ."""
