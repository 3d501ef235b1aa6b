"""Recordings with their leaf and context."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Activity = Literal["still", "moving", "sliding", "contact", "tilting", "turning", "swinging"]


ABOVE = " + z_offset"
"""Suffix of a pose expression above another."""
GRASPS = ("_pose", "_balance")
"""Endings of the names of poses at which an object is held as it is usually."""


@dataclass(frozen=True, slots=True)
class Context:
    """Context of a recording: the plan's symbolic state, not the world's truth.

    Attributes:
        activity: `still` in free air, `moving` in free air, `sliding` (a held object dragged along
            its support), `contact` (pressing on a surface after a guarded motion), `tilting` (held
            still in free air at several tilts, one after the other), `turning` (turned about the vertical
            there, and back) or `swinging` (turned to and fro there).
        at: the pose expression last reached.
        holding: the object between the fingers, if any.
        grasp: the pose expression at which it was grasped.
        support: the surface touched or slid upon, if any.
    """

    activity: Activity
    at: str | None = None
    holding: str | None = None
    grasp: str | None = None
    support: str | None = None

    @property
    def is_elsewhere(self) -> bool:
        """True if what is held is neither where it was grasped nor right above that, having been
        dragged or carried."""
        here, grasp = self.at or "", self.grasp or ""
        return here.replace(ABOVE, "") != grasp.replace(ABOVE, "")

    @property
    def place_of(self) -> str | None:
        """The object at whose grasp pose, or above it, the hand was."""
        name, _, _ = (self.at or "").partition(" ")
        for ending in GRASPS:
            if name.endswith(ending):
                return name.removesuffix(ending)
        return None


@dataclass(frozen=True, slots=True)
class Recording:
    """A window of the trace that a sensing leaf marked as measured.

    `buffer` is `gripper_forces`, `gripper_pose` or a third party's own; the samples are
    `trace.samples.between(start, end)`. `reading` holds the values of a sensor that is not the
    arm's.
    """

    buffer: str
    start: float
    end: float
    context: Context
    node: str = ""
    reading: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Conversion:
    """A conversion leaf's word that a buffer stands for a quantity of an object."""

    primitive: str
    object: str
    quantity: str
    recording: Recording
    time: float


@dataclass(frozen=True, slots=True)
class LeafRun:
    """Execution of a leaf, from its first tick to its last, in robot time (s)."""

    node: str
    """Path in the plan, e.g. `tree.children[3]`."""
    primitive: str
    label: str
    start: float
    end: float
    status: Literal["SUCCESS", "FAILURE", "INVALID"]
    message: str = ""
    context: Context | None = None
    """Symbolic state after the leaf ended."""


Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Link:
    """A part of an arm that moves, at joint angles 0, in the axes of its base.

    Attributes:
        joint: index of the last hinge that moves it.
        mass: kg.
        com: m.
        inertia: about its centre of mass, xx yy zz xy xz yz, kg m².
    """

    joint: int
    mass: float
    com: Triple
    inertia: tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class Chain:
    """The nominal kinematics of a serial arm, at joint angles 0, in the axes of its base.

    Attributes:
        axes: unit axis of each hinge, from the base on.
        anchors: a point on it, m.
        tcp: m.
        tool: the rows of the tool's rotation matrix.
        links: what moves, hand and fingers among it; none in a trace that does not say.
    """

    axes: tuple[Triple, ...]
    anchors: tuple[Triple, ...]
    tcp: Triple
    tool: tuple[Triple, Triple, Triple]
    links: tuple[Link, ...] = ()


@dataclass(frozen=True, slots=True)
class Hand:
    """Nominal arm for estimators, plots and files: geometry, datasheet accuracy, names.

    Attributes:
        tip_offset: distance from the TCP to the end of the fingertips along the tool axis, m.
        force_repeatability: N, per approach.
        torque_gain: relative, half width.
        pose_repeatability: m.
        force_resolution: N.
        force_accuracy: N, of a force that is referred to nothing.
        tip_offset_std: m, how well `tip_offset` is known.
        tip_compliance: m/N, of pads and joints beyond the encoders, under a force along the tool.
        tip_compliance_std: how well that is known.
        gain_covariance: (7, 7), of the joints' relative gain errors that were measured and corrected;
            None where `torque_gain` is all that is known.
        chain: what the joints do to the TCP; None where that was not written down.
        joints, fingers: their names, as logged; a trace from before arms could be chosen names none,
            and is an FR3's.
    """

    tip_offset: float
    force_repeatability: float
    torque_gain: float
    pose_repeatability: float
    joints: tuple[str, ...] = tuple(f"fr3_joint{i}" for i in range(1, 8))
    fingers: tuple[str, str] = ("fr3_finger_joint1", "fr3_finger_joint2")
    force_resolution: float = 0.05
    force_accuracy: float = 0.8
    tip_offset_std: float = 2e-4
    tip_compliance: float = 0.0
    tip_compliance_std: float = 1e-6
    gain_covariance: tuple[tuple[float, ...], ...] | None = None
    chain: Chain | None = None
