"""A finished run made by hand, and a stand-in robot that ticks a tree."""

from finished_run import data, trace
from standin import blackboard, node, plan, robot, scene, words

__all__ = ["blackboard", "data", "node", "plan", "robot", "scene", "trace", "words"]
