"""Synthetic recordings, and a finished run, made by hand."""

from finished_run import data, trace
from recordings import bench, noises, weighing

__all__ = ["bench", "data", "noises", "trace", "weighing"]
