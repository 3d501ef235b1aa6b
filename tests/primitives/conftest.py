"""Primitives, performed one at a time."""

from performing import after, make, perform, reached, scene, start

__all__ = ["after", "make", "perform", "reached", "scene", "start"]
