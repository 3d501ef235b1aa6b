"""Size: the numbers."""

OPENING = 2e-4
"""m (1 sigma): how well the fingers tell how far they are open: their drives' backlash and the pads'
wear. Sensitive: size std ×0.6–1.8."""

OPENING_HELD = 1e-3
"""m (1 sigma): how well that is an object's width once they have taken hold of it; rubber pads and what
is between them give way by so much under 50 N. Sensitive: no, where it is seen as they close."""

FIRST_SQUEEZE = 0.25
"""part of what gives way as the fingers take hold (with 50 N or so) that had given way as they met the
object (with 10 N); its 1 sigma as well. Sensitive: size 0.5 σ."""

FIRST_MET = 0.9
"""quantile of the openings at which the fingers rested that is the first one: they rest twice for 0.1 s
or more. Sensitive: no."""

FINGERS_REST = 2e-3
"""m/s below which the fingers count as resting. Sensitive: no."""

GRASP_YIELDS = 5e-3
"""m that what is grasped gives way by at most. Sensitive: no."""

ALIGNED = 0.98
"""cosine from which two directions count as one; 11°, across which a width is 2 % wrong. Sensitive:
no."""

EXTENT_PRIOR = 0.25
"""part of an extent that is its 1 sigma before measuring. Sensitive: no."""

SAME_SUPPORT = 0.05
"""m from where the scene has an object's bottom that a touched surface may be, to be what it stands on.
Sensitive: no."""
