"""Synthetic recordings."""

from recordings import bench, noises, weighing

__all__ = ["bench", "noises", "weighing"]
