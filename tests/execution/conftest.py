"""A stand-in robot that the tree is ticked on."""

from standin import blackboard, node, plan, robot, scene, words

__all__ = ["blackboard", "node", "plan", "robot", "scene", "words"]
