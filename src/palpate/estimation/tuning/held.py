"""Tuning numbers of the centre of mass and the inertia of a held object."""

# Centre of mass, from holds.

GRASP_SHIFT = 2e-4
"""m (1 sigma): slip of an object along the fingers as it is put down, without its droop and the repeatability of the
arm; a hammer and a bar, put down six times in the simulation, came to lie within 0.2 mm of the place predicted by
these. Sensitive: com std ×0.9–1.2."""

AT_GRASP = 0.05
"""s before and after the hand closed, over which its pose is averaged. Sensitive: no."""

PLACE_ACCURACY = 5e-4
"""m (1 sigma): error of the place of an object in a scene whose poses were measured. Sensitive: com std ×0.9–1.2."""

GRIP_TURN = 0.07
"""rad per N m (root mean square of half a normal): rotation of a load between two pads by its moment, as of pads of
silicone, 20 mm wide, 2 mm thick, with a shear modulus of 0.5 MPa. Sensitive: com z 0.4 σ, std ×0.97–1.1."""

GRIP_CREEP = 0.02
"""rad/s per N m: likewise, rate of creep while it is held. No published figure of a hand. A hammer held beside its
balance point turns by 0.018 in the simulation (by a moment of 0.23 N m, from the 25th second to the 43rd), as its
regularised friction always creeps; recordings of tilts and swings show the creep in their run. Sensitive: com z 0.5
σ, std ×0.9–1.25."""

GRIP_SLIDE = 1e-3
"""m per rad (1 sigma): slip of a load along either axis of the pads as the hand tilts. No published figure of a
hand. In the simulation a hammer of 0.34 kg slid by 0.4 mm a radian along the fingers' plane and a bar of 0.4 kg by
1.2, while the hand turned and hardly while it rested. Sensitive: com std ×0.8–1.5 where it was tilted."""

COM_ITERATIONS = 1
"""solutions before the last. Sensitive: no."""

ARM_WEIGHT = 100.0
"""N m per m: apparent moment at the hand by the arm's own weight, per error of its pose. Sensitive: no."""

SEEN = 0.05
"""part of a coordinate that gravity must show at some grasp for it to be seen. Sensitive: no."""

COM_PRIOR = 0.25
"""part of the object's extent that is the 1 sigma of a coordinate of the centre of mass before measuring. Sensitive:
com std ×0.5–2.0."""

BLIND = 0.5
"""remaining part of that 1 sigma above which a coordinate counts as not measured. Sensitive: no."""

TURN_BINS = 8
"""parts of a turn, to a tilt or about the vertical, of which the first and the last are left out. Sensitive: no."""

TILT_HELD = 0.5
"""s that a tilt is held at least. Sensitive: no."""

TURN_STEADY = 0.5
"""rad/s², up to which the hand turns evenly: 3 mN m of a load of 0.006 kg m². Sensitive: no."""

# Inertia, from swings.

ARM_SWING = 3e-4
"""part (1 sigma) of the torques of the empty swing that changes with a load for no known reason: the linearity of a
sensor is no better than a thousandth of its torque. Sensitive: hardly."""

ARM_BENT = 0.05
"""part (1 sigma) of the change of the links' inertial torques with a load that is unknown: nominal inertias are some
per cent off. Sensitive: inertia std ×0.9–1.2."""

ARM_RUBS = 0.03
"""part (1 sigma) of the friction in the empty swing by which its part in phase with the angle changes with a load for
no known reason. Chosen on six hammers at `measured`: their two large components are 0.76 (rms) of their deviations off,
with half of it 0.88, without it 1.08. Sensitive: inertia std ×0.7 without it at `measured`, ×0.9 at `lab`."""

ARM_STICKS = 0.01
"""part (1 sigma) of a joint's dry friction, likewise, in swings in which it hardly turns.
Chosen on the same six: without it two of them are contradicted. Sensitive: inertia std ×0.8–1.4 without it."""

SAME_AXIS = 0.98
"""cosine between the axes of two swings that compare. Sensitive: no."""

SAME_RATE = 0.02
"""part by which their rates may differ. Sensitive: no."""

TURNING_POINT = 0.04
"""s in which a commanded swing may seem to stand still. Sensitive: no."""

SHORTEST_SWING = 0.8
"""s: a shorter turn of the hand is no swing. Sensitive: no."""

RATE_SEARCH = (0.05, 0.005, 0.0005)
"""parts of a rate within which it is looked for, one after the other. Sensitive: no."""

RATE_STEPS = 21
"""rates that are tried each time. Sensitive: no."""

SWING_FLOOR = 3e-4
"""N m: noise that is always assumed, with the play of pads and joints. Sensitive: inertia std ×0.9–1.1."""

LOG_MASS_PRIOR = 3.0
"""1 sigma of half the logarithm of a mass: nothing is known of it. Sensitive: no."""

RADIUS_PRIOR = 0.35
"""1 sigma of the logarithm of how far the mass lies from its centre: in the core it is half of the box's, at the rim
nearly twice; an inertia is that squared. Sensitive: weak axes' std ×0.5–2.0."""

SKEW_PRIOR = 0.3
"""part of that distance (1 sigma) by which the mass lies askew to the body's axes. Sensitive: no."""

GIVE_PRIOR = 4e-4
"""s² (1 sigma): compliance between pads and object per square of the rate: it rings at 8 Hz or more. Sensitive:
inertia std ×0.8–1.2."""

# A load that was carried through a recording.

CARRIED_PRIOR = (30.0, 10.0, 1.0)
"""kg, kg m and kg m² (1 sigma) of a load: nothing is known of it. Sensitive: no."""

HAND_PRIOR = (3.0, 0.5, 0.05)
"""the same of an unknown end effector. Sensitive: no."""

CARRIED_HALF = 1.0
"""s at least of each half of a window whose masses are compared. Sensitive: no."""

COM_BELIEVED = 0.05
"""m (1 sigma): a load's centre of mass is believed to be that near to the fingertips. Sensitive: no."""

RADIUS_BELIEVED = 0.1
"""m: radius of gyration that a load is believed to have at most. Sensitive: no."""

CARRIED_APART = 0.03
"""part of the mass (1 sigma) by which halves of a window may differ: more is a load that came or went.
Sensitive: no."""

CARRIED_LEAST = 0.005
"""kg (1 sigma), likewise. Sensitive: no."""

SURELY = 3.7
"""standard deviations by which a mass or a friction is surely beyond a limit: chance exceeds them in one of 10 000.
Sensitive: no."""

THINNEST = 2e-3
"""m: radius of gyration along any axis that every load has. Sensitive: no."""

CARRIED_SHORTEST = 0.5
"""s: shorter stretches with or without a load are left out. Sensitive: no."""

RESTARTED = 5.0
"""s without a row after which the sensors may have been zeroed anew: another recording ... Sensitive: no."""

LIKELY_RESTART = (0.7, 0.3)
"""... and how likely they were not, and were. Chosen, without a source. Sensitive: no at 0.9."""
