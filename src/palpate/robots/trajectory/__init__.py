"""Bounded-jerk motions: piecewise quintic polynomials in time, from any state of motion to rest."""
