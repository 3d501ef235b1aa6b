"""The one `<inertial>` of an object: where its mass, centre of mass and inertia stand.

Without an `<inertial>`, MuJoCo infers all three from the geoms. A mass alone is then written on the
geoms that lack one, shared by volume; a centre of mass or an inertia makes a new `<inertial>`,
which has to state all three.
"""
