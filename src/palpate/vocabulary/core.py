"""palpate's own twelve primitives, in the order in which people read them."""

from palpate.vocabulary.conversion import (
    Force2Mass,
    Force2Momentum,
    Force2Velocity,
    Pose2Height,
    Pose2Plan,
)
from palpate.vocabulary.gripper import CloseGripper, OpenGripper
from palpate.vocabulary.motion import MoveJoints, MovePose, MoveUntilContact
from palpate.vocabulary.sensing import MeasureForces, MeasureGripperPose

__all__ = [  # noqa: RUF022 - reading order
    "MovePose",
    "MoveJoints",
    "OpenGripper",
    "CloseGripper",
    "MoveUntilContact",
    "MeasureForces",
    "MeasureGripperPose",
    "Force2Mass",
    "Force2Velocity",
    "Force2Momentum",
    "Pose2Height",
    "Pose2Plan",
]
