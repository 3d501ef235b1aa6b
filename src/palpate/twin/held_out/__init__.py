"""Validation of the twin on motions to which it was not fitted.

Of every lifted object one motion is held out: the last lift of several, else the way back down after the
measurement. It is cut out of the trace, the estimates are made again from the rest, and the joint
torques of the motion are predicted from them (`palpate.twin.held_out.prediction`). The measured ones pass
three tests, with the false alarms of all tests of fit: the object's weight, its balance about the
predicted centre of mass, and the rest of the torques.
"""
