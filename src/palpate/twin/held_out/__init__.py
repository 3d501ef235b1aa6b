"""The twin judged on motions that it was not fitted to.

Of every object that was lifted, one motion is held out: the last lift where there are several, else
the way back down after it was measured. All that was recorded of it is cut out of the trace, the
estimates are made again from the rest, and the joint torques of the motion are predicted from them
(`palpate.twin.held_out.prediction`). What was measured then passes three tests, with the false alarms of all
tests of fit: whether the object weighs what was predicted, whether it hangs where its centre of mass
says, and whether anything else is left in the torques.
"""
