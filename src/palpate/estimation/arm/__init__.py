"""Dynamics of the arm itself, from a recording of its joint signals."""
