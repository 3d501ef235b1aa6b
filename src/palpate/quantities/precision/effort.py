"""Effort for a parameter: number and speed of lifts of its object, or number of repetitions."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.geometry.pose import Pose
from palpate.parameter import Parameter
from palpate.robots.description import RobotDescription


@dataclass(frozen=True, slots=True)
class Effort:
    """Attributes:
    cycles: how often the object is taken, lifted and put back.
    speed: m/s of the ways between grasp and lift, loaded and empty; None is as fast as is safe.
    times: how often all of it is measured, one time after the other.
    """

    cycles: int = 1
    speed: float | None = None
    times: int = 1


@dataclass(frozen=True, slots=True, eq=False)
class Site:
    """Workplace of an object: arm, grasp and lift poses.

    Attributes:
        parameter: what the work is for.
        arm: that works.
        pose_world_base: where it stands.
        grasp, above: poses of the TCP in the world, where the object is taken and lifted to.
        believed: what is believed of the quantity, one number a component.
        gravity: m/s², magnitude.
        near_speed: m/s, the fastest near things.
    """

    parameter: Parameter
    arm: RobotDescription
    pose_world_base: Pose
    grasp: Pose
    above: Pose
    believed: tuple[float, ...]
    gravity: float
    near_speed: float
