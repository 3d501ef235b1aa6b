"""Exact sweep: minimum distances of the arm, the hand and the held object on a motion.

The way is looked at in moments. Between two of them no shape travels farther than its middle plus
its radius times the turn; so where two shapes are farther apart at both than what they travel, they
do not meet between them. Boxes rule out nearly all pairs, for all moments at once; what is left is
measured exactly, and halved until it is clear or found out (conservative advancement).
"""
