"""Primitives that move the arm to where it is told, and what they are made of."""
