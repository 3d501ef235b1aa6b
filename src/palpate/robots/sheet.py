"""`description.yaml`: the figures of an arm and its hand, and the thresholds of its collision reflex."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
from pydantic import Field, PlainSerializer, PlainValidator, ValidationError

from palpate.common.errors import InputError, unknown_name
from palpate.common.files import Section, describe_error, plain_yaml, read_text
from palpate.common.pose import Array


@dataclass(frozen=True, slots=True)
class Links:
    """Thresholds of the joint torques for contact of a link, as opposed to contact of the hand or its load.

    A force f within `lever` of the TCP is a force at the TCP with a moment of at most `lever` |f|. Torques
    that a force at the TCP alone does not explain (`palpate.robots.nominal.explain_torque`) come from that
    moment, from friction or from the sensors.
    """

    torque: float  # N m, norm over the joints, of their friction and of the sensors' errors
    lever: float  # m
    # N m, norm over the joints of the sudden change of the external torques that friction and sensors
    # explain. The empty hand in free air meets no force at all.
    change: float = math.inf

    def stop_reason(self, unexplained: float, force: float, change: float = 0.0) -> str | None:
        """Return the reason to stop at `unexplained` N m together with a `force`, N, and a sudden `change` of the
        torques, N m; None without one.
        """
        most = self.torque + self.lever * force
        if change > self.change:
            return (
                f"unexpected contact: the arm stopped itself as the torques of its joints changed suddenly by "
                f"{change:.1f} N m, more than {self.change:.1f} N m"
            )
        if unexplained <= most:
            return None
        return (
            f"unexpected contact: a link met something: its joints bear {unexplained:.1f} N m that no "
            f"force on the hand explains, more than {most:.1f} N m"
        )


@dataclass(frozen=True, slots=True)
class Reflex:
    """Thresholds of the external wrench, without the carried load, at which the arm stops itself."""

    force: float  # N, magnitude at the TCP
    torque: float  # N m, magnitude at the TCP
    load: float = 0.0  # N of weight on the hand, straight down, allowed in addition
    sideways: float = math.inf  # N, of the horizontal force alone
    links: Links | None = None  # thresholds for contacts of the arm's links; None: not checked
    # N, world axes: force on a hand that starts a motion from a contact, at rest there. The joints'
    # friction keeps some of it on the way. A new contact then adds to the change as the old contact
    # ends. So a force beyond `force` counts only if its change is beyond `force` as well.
    pressed: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def least(self) -> float:
        """The smallest threshold, N or N m."""
        return min(self.force, self.torque, self.sideways)

    def fired(self, contact: Array) -> str | None:
        """Return the reason to stop at the external wrench `contact` (6,), by the convention of
        `palpate.trace`; None without one.
        """
        x, y, z, turn_x, turn_y, turn_z = contact.tolist()
        # The carried load reduces the vertical force, up to its allowance.
        force = math.hypot(x, y, z - min(max(z, 0.0), self.load))
        sideways, torque = math.hypot(x, y), math.hypot(turn_x, turn_y, turn_z)
        if force > self.force and math.dist((x, y, z), self.pressed) > self.force:
            excess = f"{force:.1f} N, more than {self.force:g} N"
        elif sideways > self.sideways:
            excess = f"{sideways:.1f} N sideways, more than {self.sideways:.0f} N"
        elif torque > self.torque:
            excess = f"{torque:.1f} N m, more than {self.torque:g} N m"
        else:
            return None
        return f"unexpected contact: the arm stopped itself at {excess}"


@dataclass(frozen=True, slots=True)
class Reflexes:
    """An arm's thresholds for each activity."""

    free: Reflex  # in free air with empty fingers
    carrying: Reflex  # with an object between them
    probing: Reflex  # in a guarded motion
    contact: Reflex  # for intended contact


# `description.yaml`: an arm with its hand, as described by its folder.


FILE = "description.yaml"
MAX_BYTES = 100_000  # largest description
EMPTY = 0.002  # m: a hand that is closed to less holds nothing
SPARE = 0.005  # m of clearance in the bounds of the hand


def finite_array(value: Any, shape: tuple[int, ...], message: str) -> Array:
    """Read an immutable array of finite numbers. Raises ValueError: `message`."""
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(message) from None
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(message)
    array.flags.writeable = False
    return array


def numbers(count: int) -> PlainValidator:
    """Make a validator of a list of `count` finite numbers."""
    return PlainValidator(lambda v: finite_array(v, (count,), f"give a list of {count} numbers"))


def joint_numbers(value: Any) -> Array:
    """Read one finite number a joint. The description compares their count with the arm's joints.

    Raises ValueError: other than a list of numbers.
    """
    message = "give a list of numbers, one a joint"
    if not isinstance(value, list | tuple | np.ndarray):
        raise ValueError(message)
    return finite_array(value, (len(cast("list[Any]", value)),), message)


AS_LIST = PlainSerializer(np.ndarray.tolist)
Joints = Annotated[Array, PlainValidator(joint_numbers), AS_LIST]  # one per joint
Vector = Annotated[Array, numbers(3), AS_LIST]
Pair = Annotated[Array, numbers(2), AS_LIST]
Size = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Name = Annotated[str, Field(min_length=1, max_length=100)]


class Workspace(Section):
    """Box about the arm's base that the TCP stays in, m."""

    min: Vector  # m
    max: Vector  # m


class Reach(Section):
    """Quick estimate of the arm's working range with the tool down, m."""

    nearest: Size  # horizontal distance of the TCP from the base
    farthest: Size  # as `nearest`
    preferred: Size  # as `nearest`
    shoulder: Size  # height of the shoulder above the base
    wrist: Size  # from the TCP up to the wrist's centre
    stretched: Size  # largest distance of the wrist's centre from the shoulder


class Box(Section):
    """Box in the tool frame."""

    centre: Vector  # m
    half: Vector  # m


class ParallelHand(Section):
    """A parallel hand: names in the MJCF, the drive, and its shape in the tool frame."""

    body: Name  # body with the fingers; z points out of the hand, y is the closing direction
    tcp: Name | Vector  # midway between the pads: a site of `body`, or a position in it, m
    fingers: tuple[Name, Name]  # the two slides
    opening: Size  # m between the open fingers
    speed: Size  # m/s per finger
    force: Size  # N, of both fingers together
    overclose: Share  # m per finger beyond contact of the pads, to which the drive closes
    palm: Size  # m from the TCP up to the palm
    half_extents: tuple[Size, Size]  # m, of the hand along tool x and tool y
    pad: Size  # m, half the width of a finger's pad
    finger: Size  # m, a finger's thickness along the closing direction
    boxes: Annotated[tuple[Box, ...], Field(min_length=1)]  # the opened hand
    pads: Box | None = None  # in each finger's own frame; absent: its colliding shapes

    @cached_property
    def breadth(self) -> float:
        """Largest distance of the opened hand from the tool's axis, m."""
        corners = [np.abs(box.centre[:2]) + box.half[:2] for box in self.boxes]
        return max(float(np.hypot(*corner)) for corner in corners) + SPARE

    @cached_property
    def height(self) -> float:
        """Largest height of the opened hand above the TCP, m."""
        return max(float(box.half[2] - box.centre[2]) for box in self.boxes) + SPARE

    @cached_property
    def depth(self) -> float:
        """Largest depth of the opened hand below the TCP, m."""
        return max(float(box.half[2] + box.centre[2]) for box in self.boxes) + SPARE


class Safety(Section):
    """Limits of the safety predicate."""

    force: Size  # N, largest external force at the TCP in any commanded interaction
    torque: Size  # N m, largest external torque at the TCP
    free_force: Size  # N: more than this in free air is a collision
    overload: Size  # N above the payload's weight, for the inertia of load and arm
    speed: Size  # m/s, TCP speed
    tracking: Size  # m, largest distance between commanded equilibrium and measured TCP
    stale: Size  # s, oldest sensor sample that may be acted upon


class Thresholds(Section):
    """Thresholds of the arm's reflex at the TCP, without the carried load."""

    force: Size  # N
    torque: Size  # N m


class ReflexSheet(Section):
    """Thresholds at which the arm stops itself, for each activity."""

    free: Thresholds  # in free air with empty fingers
    carrying: Thresholds  # with an object between them
    probing: Thresholds  # in a guarded motion
    contact: Thresholds  # for intended contact


class OwnReflex(Section):
    """Thresholds of this very arm, N and N m. Absent: those of the description."""

    free: Thresholds | None = None  # in free air with empty fingers
    carrying: Thresholds | None = None  # with an object between them
    probing: Thresholds | None = None  # in a guarded motion
    contact: Thresholds | None = None  # for intended contact


class ControllerStiffness(Section):
    """Stiffness of the controller's springs."""

    translation: Size  # N/m, at the TCP
    rotation: Size  # N m/rad
    joints: Joints  # N m/rad


class Hardware(Section):
    """Values in which a real arm differs from a simulated one. Absent: it does not."""

    stiffness: ControllerStiffness  # stable in a control loop at 1 kHz, and soft for a person
    rest_torque: Share = 0.0  # N m that friction and ripple leave in each joint at rest
    # m, uncertainty of the pads' end against the drawings, without calibration; absent: the datasheet's
    tip_offset_std: Size | None = None


class Cautious(Section):
    """Lower limits of cautious motions."""

    speed: Size  # m/s
    turning_speed: Size  # rad/s
    joint_speed: Size  # rad/s
    impulse: Size  # N s


class MotionLimits(Section):
    """Limits of commanded motions of the TCP and of the joints."""

    speed: Size  # m/s
    turning_speed: Size  # rad/s
    joint_speed: Size  # rad/s
    acceleration: Size  # m/s^2
    turning_acceleration: Size  # rad/s^2
    joint_acceleration: Size  # rad/s^2
    impulse: Size  # N s to an obstacle, which limits the speed where the effective mass is large
    restitution: Share  # of such contacts, 0 to 1
    cautious: Cautious  # limits near objects that no scene shows
    # m/s^2, of the TCP in free air; absent: the arm must not swing
    swinging_acceleration: Size | None = None


class Accuracy(Section):
    """Accuracy stated by the manufacturer, and the uncertainty of the pads' end."""

    force_repeatability: Size  # N, per approach
    torque_gain: Size  # relative, half width
    pose_repeatability: Size  # m
    force_resolution: Size = 0.05  # N
    force_accuracy: Size = 0.8  # N, of an absolute force
    tip_offset_std: Size = 2e-4  # m, from the TCP to the pads' end


class SensorErrors(Section):
    """Errors of the joint torque signals, and standard deviations of the links from the nominal ones."""

    torque_noise: Joints  # N m, standard deviation of a 1 kHz sample
    friction: Joints  # N m, largest friction of bearings, seals and cables behind the sensor
    drift: Share  # N m, standard deviation of a signal's drift
    link_mass: Share  # relative
    link_com: Share  # m per axis


Six = Annotated[Array, numbers(6), AS_LIST]  # three forces, N, and three moments, N m


class WristSheet(Section):
    """Six-axis force/torque sensor between flange and hand, with the figures of its data sheet."""

    label: Name  # product
    height: Share = 0.0  # m, by which it lengthens the arm; 0 where the MJCF already has it
    mass: Share = 0.0  # kg, of the whole sensor; 0 likewise
    radius: Size = 0.04  # m
    range: Six  # N, N m
    white: Six  # N, N m, standard deviation of a 1 kHz sample
    drift: Six  # N, N m, standard deviation of the drift of the zero
    drift_time: Size = 300.0  # s, time constant of that drift
    gain: Size  # relative, standard deviation, of all axes together
    crosstalk: Share  # relative, standard deviation; N per N m over 0.3 m
    mounting: Share = 0.005  # rad, standard deviation of its orientation


class Sheet(Section):
    """The content of a `description.yaml`."""

    label: Name  # title of the arm
    mjcf: Path  # the arm's file, relative to the folder
    joints: tuple[Name, ...]  # the hinges, from the base on
    home: Joints  # rad, tool down
    velocity: Joints  # rad/s
    torque: Joints | None = None  # N m; absent: the MJCF's `actuatorfrcrange`
    # gear ripples per turn of each joint; absent: unknown
    ripple_cycles: Annotated[tuple[Size, ...], Field(min_length=1)] | None = None
    payload: Size  # kg
    workspace: Workspace
    reach: Reach
    hand: ParallelHand
    safety: Safety
    reflex: ReflexSheet
    stiffness: ControllerStiffness
    pace: MotionLimits
    accuracy: Accuracy
    sensors: SensorErrors
    postures: tuple[Joints, ...]  # rad, relative to home: further seeds of the inverse kinematics
    hardware: Hardware | None = None
    wrench_sensor: WristSheet | None = None  # absent: the arm has none


OWN = {
    "label",
    "mjcf",
    "joints",
    "home",
    "velocity",
    "torque",
    "ripple_cycles",
    "payload",
    "workspace",
    "wrench_sensor",
}
INHERITED = [key for key in Sheet.model_fields if key not in OWN]  # where a file has `like: NAME`


def read_sheet(folder: Path, known: Mapping[str, Path]) -> Sheet:
    """Read and validate the `description.yaml` in a folder; `known` has the folders of the arms that it may
    be `like`. Raises InputError: unreadable, not YAML, or not of this form; the message names file and key.
    """
    path = folder / FILE
    try:
        return Sheet.model_validate(_content(path, known))
    except ValidationError as error:
        raise InputError(f"{path}: {describe_error(error, Sheet)}") from None


def _content(path: Path, known: Mapping[str, Path]) -> Any:
    """Read the file, completed with the description of the arm named by `like`."""
    content: Any = plain_yaml(read_text(path, MAX_BYTES, "the description of an arm"), str(path))
    if not isinstance(content, dict):
        return None
    own = cast("dict[str, Any]", content)
    if "like" not in own:
        return own
    like = str(own.pop("like"))
    if like not in known or known[like] == path.parent:
        raise unknown_name("arm", like, known, f"It is named by 'like' in {path}.")
    other = _content(known[like] / FILE, known)
    return merge_sections({key: other[key] for key in INHERITED if key in other}, own)


def merge_sections(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Merge two files' contents section by section; `above` replaces `below`."""
    both: dict[str, Any] = {**below}
    for key, value in above.items():
        under = below.get(key)
        # In a noise model {fixed: VALUE} is a value, not a section.
        if not isinstance(under, dict) or "fixed" in under:
            under = {}
        if isinstance(value, dict) and "fixed" not in value:
            value = merge_sections(cast("dict[str, Any]", under), cast("dict[str, Any]", value))
        both[key] = value
    return both
