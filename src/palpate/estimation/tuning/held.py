"""Tuning numbers of the centre of mass and the inertia of a held object."""

# Centre of mass, from holds.

GRASP_SHIFT = 2e-4
"""m (1 sigma): how far an object slips along the fingers as it is put down, beside what its droop and
the arm's repeatability make of it; a hammer and a bar, put down six times in the simulation, came to
lie within 0.2 mm of where these had them. Sensitive: com std ×0.9–1.2."""

AT_GRASP = 0.05
"""s before and after the hand closed, over which its pose is averaged. Sensitive: no."""

PLACE_ACCURACY = 5e-4
"""m (1 sigma): how far a scene whose poses were measured may have an object from where it is.
Sensitive: com std ×0.9–1.2."""

GRIP_TURN = 0.07
"""rad per N m (root mean square of half a normal): what a load's moment turns it by between two pads.
Pads of silicone, 20 mm wide, 2 mm thick, of a shear modulus of 0.5 MPa turn by so much. Sensitive: com z
0.4 σ, std ×0.97–1.1."""

GRIP_CREEP = 0.02
"""rad/s per N m: likewise, as it creeps while it is held. No published figure of a hand. A
hammer held beside its balance point turns by 0.018 in the simulation (of a moment of 0.23 N m, from
the 25th second to the 43rd), whose regularised friction lets no grip hold still; recordings of tilts
and swings tell how much it is in their run. Sensitive: com z 0.5 σ, std ×0.9–1.25."""

GRIP_SLIDE = 1e-3
"""m per rad (1 sigma): how far a load slides along the pads as a tilt turns the hand with it, along
either axis of the pads. No published figure of a hand. In the simulation a hammer of 0.34 kg slid by
0.4 mm a radian along the fingers' plane and a bar of 0.4 kg by 1.2, while the hand turned and hardly
while it rested. Sensitive: com std ×0.8–1.5 where it was tilted."""

COM_ITERATIONS = 1
"""solutions before the last. Sensitive: no."""

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

TURN_BINS = 8
"""parts of a turn, to a tilt or about the vertical, of which the first and the last are left out. Sensitive: no."""

TILT_HELD = 0.5
"""s that a tilt is held at least. Sensitive: no."""

TURN_STEADY = 0.5
"""rad/s², up to which the hand turns evenly: 3 mN m of a load of 0.006 kg m². Sensitive: no."""

# Inertia, from swings.

ARM_SWING = 3e-4
"""part (1 sigma) of what the arm feels as it swings empty that is another with a load for no known
reason: a thousandth of a joint's torque is beyond its sensor's linearity. Sensitive: hardly."""

ARM_BENT = 0.05
"""part (1 sigma) of what moves the arm's links otherwise with a load that is not known: nominal
inertias are some per cent off. Sensitive: inertia std ×0.9–1.2."""

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
"""N m: noise that is always assumed, and what the pads' and the joints' play leave. Sensitive: inertia
std ×0.9–1.1."""

LOG_MASS_PRIOR = 3.0
"""1 sigma of half the logarithm of a mass: nothing is known of it. Sensitive: no."""

RADIUS_PRIOR = 0.35
"""1 sigma of the logarithm of how far the mass lies from its centre: in the core it is half of the
box's, at the rim nearly twice; an inertia is that squared. Sensitive: weak axes' std ×0.5–2.0."""

SKEW_PRIOR = 0.3
"""part of that distance (1 sigma) by which the mass lies askew to the body's axes. Sensitive: no."""

GIVE_PRIOR = 4e-4
"""s² (1 sigma): what gives way between pads and object, by the square of the rate: it rings at 8 Hz or
more. Sensitive: inertia std ×0.8–1.2."""
