"""Recordings with their context, and logs of arms by other programs."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from palpate.common.pose import Array

Activity = Literal[
    "still", "moving", "sliding", "contact", "tilting", "turning", "swinging", "working", "limit"
]
Triple = tuple[float, float, float]

ABOVE = " + z_offset"  # Suffix of an expression for a pose above another pose
RECORDED = "Recording"  # Primitive of the conversions of a recording by another program
GRASPS = ("_pose", "_balance")  # Endings of the names of poses at which an object is usually held


def pose_name(expression: str) -> str:
    """Return the name of the pose with which a pose expression begins: `red mug_pose` of `red mug_pose +
    z_offset`.
    """
    return re.split(" [+-] ", expression, maxsplit=1)[0]


@dataclass(frozen=True, slots=True)
class Context:
    """Context of a recording: the plan's symbolic state, not the world's truth."""

    # `still` in free air, `moving` in free air, `sliding` (a held object is dragged along its
    # support), or `contact` (pressing on a surface after a guarded motion). In free air also
    # `tilting` (still at several tilts in turn), `turning` (about the vertical, and back) or
    # `swinging` (a sinusoidal rotation). For a fixture `working` (it is moved along its joint, or
    # the empty hand repeats that motion) or `limit` (it is moved to the limits of its joint).
    activity: Activity
    at: str | None = None  # pose expression last reached
    holding: str | None = None  # object between the fingers, if any
    # Pose expression at which it was grasped; in a recording by another program, numbers: position
    # (m) and quaternion wxyz of the object in the hand.
    grasp: str | None = None
    support: str | None = None  # surface touched or slid on, if any

    @property
    def is_elsewhere(self) -> bool:
        """Test if the held object was dragged or carried away.

        It is then neither at the pose where it was grasped nor directly above.
        """
        here, grasp = self.at or "", self.grasp or ""
        return here.replace(ABOVE, "") != grasp.replace(ABOVE, "")

    @property
    def place_of(self) -> str | None:
        """Object whose grasp pose the hand was at or above; None if there is none."""
        # Remove the ending of a grasp pose from its name.
        name = pose_name(self.at or "")
        for ending in GRASPS:
            if name.endswith(ending):
                return name.removesuffix(ending)
        return None


@dataclass(frozen=True, slots=True)
class Recording:
    """Window of the trace that a sensing leaf marked as measured.

    `buffer` is `gripper_forces`, `gripper_pose` or a third party's own; the samples are
    `trace.samples.between(start, end)`. `reading` holds the values of a sensor other than the arm's.
    """

    buffer: str
    start: float
    end: float
    context: Context
    node: str = ""
    reading: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Conversion:
    """Declaration by a conversion leaf: the recording measures a quantity of an object."""

    primitive: str
    object: str
    quantity: str
    recording: Recording
    time: float


@dataclass(frozen=True, slots=True)
class LeafRun:
    """Execution of a leaf, from its first tick to its last, in robot time (s)."""

    node: str  # Path in the plan, e.g. `tree.children[3]`.
    primitive: str
    label: str
    start: float
    end: float
    status: Literal["SUCCESS", "FAILURE", "INVALID"]
    message: str = ""
    context: Context | None = None  # Symbolic state after the leaf ended


@dataclass(frozen=True, slots=True)
class ChainLink:
    """Moving link of an arm, at joint angles 0, in the axes of its base."""

    joint: int  # index of the last hinge that moves it
    mass: float  # kg
    com: Triple  # its centre of mass, m
    # About its centre of mass, xx yy zz xy xz yz, kg m².
    inertia: tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class Chain:
    """The nominal kinematics of a serial arm, at joint angles 0, in the axes of its base."""

    axes: tuple[Triple, ...]  # unit axis of each hinge, from the base on
    anchors: tuple[Triple, ...]  # a point on each axis, m
    tcp: Triple  # position of the TCP, m
    tool: tuple[Triple, Triple, Triple]  # rows of the tool's rotation matrix
    # The moving links, hand and fingers included; empty in an older trace.
    links: tuple[ChainLink, ...] = ()


@dataclass(frozen=True, slots=True)
class WrenchSensor:
    """Six-axis force/torque sensor, as its owner knows it.

    It measures the wrench that the arm exerts on everything mounted below it, about the sensor's origin and in its
    axes. A load at rest below a sensor with a vertical z axis reads +m g along z.
    """

    label: str  # product, or the columns of a recording
    # Pose of the sensor in the frame of the TCP: position (m) and quaternion wxyz.
    pose_tcp_sensor: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    gain: float = 0.01  # relative error of all axes together, standard deviation
    crosstalk: float = 0.005  # response to another axis, N per N or N per N m over 0.3 m, 1 sigma
    mounting: float = 0.01  # rad, error of its orientation, standard deviation


@dataclass(frozen=True, slots=True)
class NominalHand:
    """Nominal arm for estimators, plots and files: geometry, datasheet accuracy, names."""

    tip_offset: float  # distance from the TCP to the end of the fingertips along the tool axis, m
    force_repeatability: float  # N, per approach
    torque_gain: float  # relative error of the joint torque sensors, half width
    pose_repeatability: float  # m
    # joints, fingers: names, as logged; an older trace without them is from an FR3.
    joints: tuple[str, ...] = tuple(f"fr3_joint{i}" for i in range(1, 8))
    fingers: tuple[str, str] = ("fr3_finger_joint1", "fr3_finger_joint2")
    force_resolution: float = 0.05  # N
    force_accuracy: float = 0.8  # N, of a single force without a reference
    tip_offset_std: float = 2e-4  # standard deviation of `tip_offset`, m
    # Compliance of pads and joints behind the encoders, under a force along the tool, m/N.
    tip_compliance: float = 0.0
    tip_compliance_std: float = 1e-6  # standard deviation of `tip_compliance`, m/N
    # (7, 7), of the joints' relative gain errors after calibration; None if only `torque_gain` is
    # known.
    gain_covariance: tuple[tuple[float, ...], ...] | None = None
    chain: Chain | None = None  # kinematics of the arm; None in an older trace
    # Gear ripples per turn of each joint; None if unknown.
    ripple_cycles: tuple[float, ...] | None = None
    payload: float = 3.0  # kg that the arm may carry; an older trace without it is from an FR3
    wrench_sensor: WrenchSensor | None = None  # sensor between flange and hand, if any


# Recording of an arm in motion, from any logging program.


@dataclass(frozen=True, slots=True, eq=False)
class ArmLog:
    """Joint signals of an arm, in the order of its chain."""

    t: Array  # (n,) s, increasing
    q: Array  # (n, 7) joint positions, rad
    dq: Array  # (n, 7) joint velocities, rad/s
    tau: Array  # (n, 7) sensed joint torques, gravity included (libfranka's tau_J), N m
    # (n, 7) the controller's own estimate of external torques, N m; None where not logged.
    tau_ext: Array | None
    source: str  # name of the file or topic, for messages
    notes: tuple[str, ...] = ()  # repairs made during reading, one sentence each

    def __len__(self) -> int:
        return len(self.t)
