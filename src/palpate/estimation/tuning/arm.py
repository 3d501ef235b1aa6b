"""Dynamics of the arm itself, from a recording of it: the numbers."""

BAND = 5.0
"""Hz up to which torque is explained: between 8 and 30 Hz the torque of a real FR3 does not follow M ddq.
Sensitive: not from 2.5 to 7 Hz; at 10 Hz, near the resonance of a soft loop, the hand's std is ×9."""

MOTION_BAND = 15.0
"""Hz up to which the motion is known from the encoders: products of it fill `BAND`. Sensitive: hand 0.1 σ, std
×1.0–1.1; others at most 1.0 σ, std ×0.9–1.1."""

CLOCK = 200.0
"""Hz of the common clock of all signals, at most. Sensitive: hand 0.1 σ, std ×1.0–1.0; others at most 1.0 σ, std
×0.9–1.0."""

SLOWEST = 0.05
"""s between rows at most: two a period of twice `BAND`. Sensitive: no."""

LOG_GAP = 0.2
"""s without a row after which a recording begins anew. Sensitive: no."""

EDGE = 0.2
"""s at both ends of a recording that its filter needs: three periods of `MOTION_BAND`. Sensitive: hand 0.1 σ, std
×0.9–1.0; others at most 2.1 σ, std ×0.9–1.2."""

UNEVEN_CLOCK = 0.03
"""part of the velocities by which they may differ from the slope of the angles: 1 % at 1 kHz on a real FR3, 11 % of
a recording at 30 Hz with even stamps. Sensitive: no."""

STRETCH = 20.0
"""s of a stretch that is transformed together. Sensitive: hand 0 σ, std ×1.0–1.0; others at most 0.1 σ, std
×1.0–1.0."""

SHORTEST_STRETCH = 2.0
"""s: shorter pieces of a recording are left out. Sensitive: no."""

SHORTEST_LOG = 5.0
"""s of motion that are needed at least: ten periods of 0.5 Hz, less a held-out part. Sensitive: no."""

LEARNT = 0.6
"""part of a recording, from its start, that predicts the rest of it. Sensitive: hand 0.1 σ, std ×1.0–1.1; others
at most 0.9 σ, std ×0.9–1.1."""

PRESLIDINGS = (1.5e-3, 6e-4, 4e-3, 1e-2)
"""rad over which parts of a joint's friction turn round: the usual one (1 to 4 mrad were seen on real arms) ...
Sensitive: hand 0.4 σ, std ×0.9–1.1; others at most 1.7 σ, std ×0.7–1.3."""

TURNED = 0.7
"""part of its level that the slowest friction reaches, 12 mrad after a joint began to turn, in both directions where
a joint shows its friction: that of one that turns one way only is no other than an offset. Sensitive: no."""

PRESLIDING_SHARE = 0.3
"""... and parts (1 sigma) of it that do so over each of the others: no law of friction is Dahl's alone. Sensitive:
hand 0.2 σ, std ×1.0–1.1; others at most 2.0 σ, std ×0.8–1.1."""

COULOMB_PRIOR = 1.0
"""N m (1 sigma): 0.15 to 0.5 were seen on real arms. Sensitive: hand 0 σ, std ×1.0–1.0; others at most 0.2 σ, std
×1.0–1.0."""

USUAL_FRICTION = 0.3
"""N m of a joint's friction before it is seen: 0.15 to 0.5. Sensitive: hand 0.1 σ, std ×1.0–1.0; others at most
1.0 σ, std ×0.9–1.0."""

UNEVEN_FRICTION = 0.1
"""part (1 sigma) of a joint's friction by which it differs between angles, by sine and cosine of one and two
turns. Chosen, without a source. Sensitive: hand 0.2 σ, std ×1.0–1.0; others at most 1.2 σ, std ×0.6–1.9."""

LOADED_FRICTION = 3e-3
"""N m of friction per N m that a joint bears (1 sigma). Chosen, without a source. Sensitive: hand 0 σ, std
×1.0–1.0; others at most 0.5 σ, std ×0.8–1.2."""

SLOW_FRICTION = 0.2
"""part (1 sigma) of a joint's friction by which slow friction is more or less than quick friction ... Sensitive:
hand 0.1 σ, std ×1.0–1.1; others at most 0.8 σ, std ×0.9–1.1."""

STRIBECK_SPEEDS = (0.05, 0.2)
"""... within each of these speeds, rad/s. Sensitive: hand 0.1 σ, std ×1.0–1.1; others at most 1.8 σ, std ×0.8–1.3."""

VISCOUS_PRIOR = 0.5
"""N m s/rad (1 sigma): 0.07 on a Panda's first joint. Sensitive: hand 0 σ, std ×1.0–1.0; others at most 0.6 σ, std
×0.7–1.2."""

ARMATURE_PRIOR = 0.3
"""kg m² (1 sigma): 0.2 to 0.6 are a Franka's motors before the sensors, and 0 behind them. Sensitive: no."""

OFFSET_PRIOR = 0.3
"""N m (1 sigma): 0.01 to 0.48 were seen on real arms. Sensitive: hand 0.3 σ, std ×1.0–1.2; others at most 1.7 σ,
std ×0.8–1.2."""

CABLE_PRIOR = 0.1
"""N m/rad (1 sigma) by which cables and hoses pull a joint back. Chosen, without a source. Sensitive: hand 0.7 σ,
std ×0.8–1.1."""

DELAY_PRIOR = 3e-3
"""s (1 sigma) between the clocks of positions and torques: three cycles of a controller. Sensitive: hand 0 σ, std
×1.0–1.0; others at most 0.1 σ, std ×1.0–1.0."""

LEAN_PRIOR = 2e-3
"""rad (1 sigma): how far the base is out of level: 2 mm/m are what a spirit level leaves. Sensitive: hand 0.2 σ,
std ×0.9–1.2; others at most 1.0 σ, std ×0.9–1.2."""

LINK_INERTIA = 0.5
"""part (1 sigma) of a link's mean moment of inertia: those of a real FR3 are off its description by more than 0.3
(evidence e^15 against 0.1). Sensitive: hand 1.4 σ, std ×0.9–3.1."""

LINK_FACTORS = (1.0, 3.0, 10.0, 30.0)
"""times the description's errors that the links' weight may be off: a description of another arm of its kind ...
Sensitive: hand 0.1 σ, std ×0.7–1.2."""

LIKELY_LINKS = (0.99, 0.006, 0.003, 0.001)
"""... and how likely each is. Chosen, without a source: a description is that of its arm. Sensitive: hand 0.1 σ,
std ×0.9–1.1."""

HAND_REACH = 0.1
"""m (1 sigma) between the centre of an unknown hand and the described one's, and its radius of gyration.
Sensitive: hand 0.1 σ, std ×1.0–1.0; others at most 1.0 σ, std ×0.8–1.0."""

CORNERS = (0.1, 0.3, 1.0, 3.0)
"""Hz below which what no cause explains is stronger ... Sensitive: hand 0.2 σ, std ×0.8–1.0; others at most 1.1 σ,
std ×0.8–1.2."""

WHITE_SHARES = (1e-4, 1e-3, 1e-2, 0.03, 0.1, 0.3, 1.0, 10.0)
"""... and its white part, of that: one pair a joint, by its likelihood. Sensitive: hand 0.2 σ, std ×1.0–1.1;
others at most 1.4 σ, std ×0.8–1.3."""

SMALLEST_RESIDUAL = 1e-3
"""N m of a frequency's coefficient: finer than any sensor. Sensitive: no."""

FIRST_RESIDUAL = 0.1
"""N m: what no cause explains, in the first round of fitting. Sensitive: hand 0.1 σ, std ×1.0–1.0; others at most
1.0 σ, std ×0.9–1.0."""

NOISE_ROUNDS = 4
"""rounds of fitting, in which the residual is learnt. Sensitive: hand 0.1 σ, std ×1.0–1.0; others at most 1.7 σ,
std ×0.8–1.1."""

OBSERVED = 0.5
"""part of its prior deviation to which a figure must be known to be shown as observed. Sensitive: no."""

CLAIM_TORQUE = 0.45
"""N m (1 sigma) of zeros, of friction about its usual size and of the residual, in the test that an arm explains its
recording; real arms leave 0.05 to 0.3. Sensitive: no wrong arm or unit passes at 0.3 to 0.5."""

CLAIM_SHARE = 0.02
"""part of the torque that holds the arm up, added to each of these. Sensitive: likewise, 0.02 to 0.03."""

CLAIM_LINKS = (0.03, 3e-3)
"""part of a link's mass, and m of its centre (1 sigma), that its description may be off: a real Panda passes as an FR3,
an iiwa 14 does not. Sensitive: likewise, half of it to 0.05 and 5 mm."""

CLAIM_GRAVITY = (0.015, 0.015, 0.03)
"""part of gravity (1 sigma) along each axis of the base that is tolerated: real arms show 0.02 across and along, other
arms 0.2 and more. Sensitive: no wrong arm or unit passes at twice of it."""

CLAIM_MASS = 0.1
"""part of the payload (1 sigma) by which a mass on the hand may exceed it. Sensitive: no."""

FRICTION_BELOW = (0.05, 0.1)
"""N m and N m s/rad below 0 that friction and damping may be: the simulated arm's damping is -0.03, a controller may
compensate for some. Sensitive: no."""

HAND_SIZE = 0.3
"""m from the TCP, beyond which no hand's centre is. Sensitive: no."""

BEYOND_RANGE = 0.2
"""rad beyond the range of a joint, where no such arm can be: ranges differ by less between its makes. Sensitive: no."""

BEYOND_SPEED = 1.5
"""times the largest speed of a joint, which no such arm exceeds; times by which velocities may differ from the change
of the angles: less than 1.01 in recordings of real arms. Sensitive: no."""

MOVED = 1e-3
"""rad in 0.1 s, from which velocities are compared with the change of the angles. Sensitive: no."""
