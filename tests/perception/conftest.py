"""A finished run, made by hand."""

from finished_run import data, trace

__all__ = ["data", "trace"]
