"""`description.yaml`: one arm with its hand, as its folder writes it down.

Lengths in m, angles in rad, forces in N, torques in N m, times in s. What the arm's MJCF states
(kinematics, inertias, joint ranges, torque limits, shapes) is not said again here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
from pydantic import Field, PlainValidator, ValidationError

from palpate.errors import InputError, unknown_name
from palpate.files.plain_yaml import Section, plain_yaml, worded
from palpate.files.read import read_text
from palpate.geometry.pose import Array

FILE = "description.yaml"
MAX_BYTES = 100_000
"""Largest description."""


def _numbers(count: int) -> Callable[[Any], Array]:
    """A validator that takes a list of `count` finite numbers."""

    def read(value: Any) -> Array:
        try:
            array = np.array(value, dtype=float)
        except (TypeError, ValueError):
            raise ValueError(f"give a list of {count} numbers") from None
        if array.shape != (count,) or not np.isfinite(array).all():
            raise ValueError(f"give a list of {count} numbers")
        array.flags.writeable = False
        return array

    return read


SPARE = 0.005
"""m that bounds of the hand leave for what only comes near."""

Seven = Annotated[Array, PlainValidator(_numbers(7))]
"""Seven numbers, one per joint."""
Vector = Annotated[Array, PlainValidator(_numbers(3))]
Pair = Annotated[Array, PlainValidator(_numbers(2))]
Size = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Name = Annotated[str, Field(min_length=1, max_length=100)]


class Workspace(Section):
    """A box about the arm's base that the TCP stays in, m."""

    min: Vector
    max: Vector


class Reach(Section):
    """Quick estimate of the arm's working range with the tool down, m.

    Attributes:
        nearest, farthest, preferred: horizontal distances of the TCP from the base.
        shoulder: height of the shoulder above the base.
        wrist: from the TCP up to the wrist's centre.
        stretched: farthest that the wrist's centre gets from the shoulder.
    """

    nearest: Size
    farthest: Size
    preferred: Size
    shoulder: Size
    wrist: Size
    stretched: Size


class Box(Section):
    """A box in the tool frame, m."""

    centre: Vector
    half: Vector


class ParallelHand(Section):
    """A parallel hand: names in the MJCF, the drive, and its shape in the tool frame.

    Attributes:
        body: the body that carries the fingers; its z points out of the hand, its y is the closing
            direction.
        tcp: midway between the fingers' pads: a site of `body`, or a position in it, m.
        pads: a box in each finger's own frame to grasp with; None where the fingers' colliding
            shapes are their pads.
        fingers: the two slides.
        opening: m between the open fingers.
        speed: m/s per finger.
        force: N, of both fingers together.
        overclose: m per finger beyond touching, to which the drive closes.
        palm: m from the TCP up to the palm.
        half_extents: m, of the hand along tool x and tool y.
        pad: m, half the width of a finger's pad.
        finger: m, a finger's thickness along the closing direction.
        boxes: the opened hand.
    """

    body: Name
    tcp: Name | Vector
    fingers: tuple[Name, Name]
    opening: Size
    speed: Size
    force: Size
    overclose: Share
    palm: Size
    half_extents: tuple[Size, Size]
    pad: Size
    finger: Size
    boxes: Annotated[tuple[Box, ...], Field(min_length=1)]
    pads: Box | None = None

    @cached_property
    def breadth(self) -> float:
        """m: no part of the opened hand is farther from the tool's axis."""
        corners = [np.abs(box.centre[:2]) + box.half[:2] for box in self.boxes]
        return max(float(np.hypot(*corner)) for corner in corners) + SPARE

    @cached_property
    def height(self) -> float:
        """m: nor farther above the TCP."""
        return max(float(box.half[2] - box.centre[2]) for box in self.boxes) + SPARE

    @cached_property
    def depth(self) -> float:
        """m: nor farther below it."""
        return max(float(box.half[2] + box.centre[2]) for box in self.boxes) + SPARE


class Safety(Section):
    """Limits of the safety predicate; see `palpate.robots.description.Limits`."""

    force: Size
    torque: Size
    free_force: Size
    overload: Size
    speed: Size
    tracking: Size
    stale: Size


class Thresholds(Section):
    """Of the arm's reflex: N and N m at the TCP, besides what is carried."""

    force: Size
    torque: Size


class ReflexSheet(Section):
    """The thresholds for what the arm does; see `palpate.robots.reflex.Reflexes`."""

    free: Thresholds
    carrying: Thresholds
    probing: Thresholds
    contact: Thresholds


class Stiffness(Section):
    """Default springs: at the TCP in N/m and N m/rad, at the joints (7,) in N m/rad."""

    translation: Size
    rotation: Size
    joints: Seven


class Hardware(Section):
    """Values in which a real arm differs from a simulated one.

    Attributes:
        stiffness: of springs that a control loop at 1 kHz keeps stable, and that give way to a person.
        tip_offset_std: m, by how much the pads' end may stand higher or lower than the drawings say,
            on an arm that nobody has calibrated; None where it is the datasheet's.
    """

    stiffness: Stiffness
    tip_offset_std: Size | None = None


class Cautious(Section):
    """Lower limits of cautious motions; see `Pace`."""

    speed: Size
    turning_speed: Size
    joint_speed: Size
    impulse: Size


class Pace(Section):
    """Of commanded motions: m/s, rad/s, m/s^2, rad/s^2, of the TCP and of the joints.

    Attributes:
        impulse: N s that the arm may give to what it runs into, which bounds the speed where its
            effective mass is large.
        restitution: of such contacts, 0 to 1.
        swinging_acceleration: of the TCP, turned to and fro in free air; None where the arm is not to
            swing.
        cautious: what stands in the place of those of the same name where nothing may be hurt that
            no scene shows.
    """

    speed: Size
    turning_speed: Size
    joint_speed: Size
    acceleration: Size
    turning_acceleration: Size
    joint_acceleration: Size
    impulse: Size
    restitution: Share
    cautious: Cautious
    swinging_acceleration: Size | None = None


class Accuracy(Section):
    """Accuracy stated by the manufacturer, and the uncertainty of the pads' end.

    Attributes:
        force_resolution: N.
        force_repeatability: N, per approach.
        force_accuracy: N, of a force that is referred to nothing.
        torque_gain: relative, half width.
        pose_repeatability: m.
        tip_offset_std: m, from the TCP to the pads' end.
    """

    force_repeatability: Size
    torque_gain: Size
    pose_repeatability: Size
    force_resolution: Size = 0.05
    force_accuracy: Size = 0.8
    tip_offset_std: Size = 2e-4


class Sensors(Section):
    """Errors of the joint torque signals, and deviations of the links from the
    nominal ones.

    Attributes:
        torque_noise: (7,) N m, standard deviation of a 1 kHz sample.
        friction: (7,) N m, what the bearings, seals and cables behind the sensor hold back at most.
        drift: N m, standard deviation of a signal's slow wander.
        link_mass: relative, link_com: m per axis, standard deviations.
    """

    torque_noise: Seven
    friction: Seven
    drift: Share
    link_mass: Share
    link_com: Share


class Sheet(Section):
    """The content of a `description.yaml`.

    Attributes:
        label: what people call it.
        mjcf: the arm's MJCF, relative to the folder.
        joints: the seven hinges, from the base on.
        home: (7,) rad, tool down.
        velocity: (7,) rad/s.
        payload: kg.
        torque: (7,) N m; None where the MJCF's `actuatorfrcrange` says it.
        postures: (7,) rad each, relative to home: where the inverse kinematics looks further.
        hardware: None where a real arm is as the simulated one.
    """

    label: Name
    mjcf: Path
    joints: tuple[Name, ...]
    home: Seven
    velocity: Seven
    torque: Seven | None = None
    payload: Size
    workspace: Workspace
    reach: Reach
    hand: ParallelHand
    safety: Safety
    reflex: ReflexSheet
    stiffness: Stiffness
    pace: Pace
    accuracy: Accuracy
    sensors: Sensors
    postures: tuple[Seven, ...]
    hardware: Hardware | None = None


INHERITED = (
    "reach",
    "hand",
    "safety",
    "reflex",
    "stiffness",
    "pace",
    "accuracy",
    "sensors",
    "postures",
    "hardware",
)
"""Keys that a description with `like: NAME` inherits."""


def read_sheet(folder: Path, known: Mapping[str, Path]) -> Sheet:
    """Read and validate the `description.yaml` in a folder; `known` are the folders of the arms
    that it may be `like`.

    Raises:
        InputError: unreadable, not YAML, or not of this form; the message names file and key.
    """
    path = folder / FILE
    try:
        return Sheet.model_validate(_content(path, known))
    except ValidationError as error:
        raise InputError(f"{path}: {worded(error, Sheet)}") from None


def _content(path: Path, known: Mapping[str, Path]) -> Any:
    """Read the file, completed with the description of the arm named by `like`."""
    content: Any = _yaml(path)
    if not isinstance(content, dict):
        return None
    said = cast("dict[str, Any]", content)
    if "like" not in said:
        return said
    like = str(said.pop("like"))
    if like not in known or known[like] == path.parent:
        raise unknown_name("arm", like, known, f"It is named by 'like' in {path}.")
    other = _content(known[like] / FILE, known)
    return _merged({key: other[key] for key in INHERITED if key in other}, said)


def _merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """`below` where `above` says nothing; section by section."""
    merged = {**below, **above}
    for key, value in above.items():
        if isinstance(value, dict) and isinstance(below.get(key), dict):
            merged[key] = _merged(below[key], cast("dict[str, Any]", value))
    return merged


def _yaml(path: Path) -> Any:
    return plain_yaml(read_text(path, MAX_BYTES, "the description of an arm"), str(path))
