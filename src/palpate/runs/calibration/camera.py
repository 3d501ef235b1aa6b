"""Calibration of a camera's pose with a tag.

The arm shows the camera a tag on its hand in many poses, or carries the camera around a fixed tag.
Each rest gives one picture. The poses are drawn at random about home and kept where the camera sees
the tag. The poses that reduce the uncertainty of the camera's pose most are chosen
(`palpate.perception.hand_eye_fit`).
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.common.errors import InputError, PalpateError
from palpate.common.pose import Array, Pose
from palpate.execution.runner import Snapshot
from palpate.execution.simulated_cell import SimulatedCell
from palpate.perception.cameras import Stream
from palpate.perception.detection import TAGS, detect
from palpate.perception.hand_eye import HAND, LYING, STICKER, believed_camera, with_camera, with_tag
from palpate.perception.hand_eye_fit import (
    FEWEST,
    CalibrationViews,
    HandEye,
    frame_of,
    hand_eye,
    stances,
    surest,
)
from palpate.perception.lens import Lens, Mount
from palpate.perception.look import LUMA
from palpate.perception.rendered import SimulatedCamera
from palpate.perception.tags import tags_of
from palpate.planning.plan import Node, Plan
from palpate.primitives.state import HOME_CONFIG
from palpate.robots.description import RobotDescription
from palpate.robots.nominal import NominalArm
from palpate.robots.robot_config import CameraConfig
from palpate.runs.calibration.gains import NamedSize
from palpate.runs.calibration.procedures import calibration_plan, scene_of_settings
from palpate.runs.calibration.session import CalibrationSession
from palpate.runs.settings import WORLD_CAMERA
from palpate.runs.workplace import cell_for
from palpate.scene.scene import Scene

# Count of poses. With 0.07 pixels of noise they determine the camera's position to 0.6 mm.
PICTURES = 24
DRAWN, KEPT = 12_000, 1000  # Configurations drawn, and the most of them from which poses are chosen
# rad: half width of the uniform distribution of each joint about home.
SPREAD = np.array([1.2, 1.0, 0.8, 1.0, 1.2, 1.2, 2.0])
LIMIT = 0.1  # rad: distance to the joint limits
CLEAR = 0.25  # m: least height of the TCP above the plane of the arm's base
# Cosine of the largest angle between a tag's normal and the direction of view.
FACING = math.cos(math.radians(50.0))
# Share of the picture's width that stays free at its edges. The camera's true pose differs from the
# believed one.
BORDER = 0.08
# Pixels: shortest side of a tag in a picture. At smaller sizes dark surroundings of the paper shift
# the detected corners.
SMALLEST = 30.0
NEAREST = 0.15  # m: least distance of the tag from the camera
TRIES = 6  # Selections of poses. Each new one leaves out the poses that the check refused.


@dataclass(frozen=True, slots=True)
class Eye:
    """A camera, real or simulated."""

    source: str  # as given on the command line
    lens: Lens  # known to its owner
    mount: Mount  # believed pose in the world, or on the hand
    shoot: Callable[[], NDArray[np.uint8]]  # takes a picture (height, width, 3), RGB


@dataclass(slots=True)
class Shots:
    """Observer that takes a picture at the end of every rest."""

    shoot: Callable[[], NDArray[np.uint8]]
    lens: Lens
    number: int
    seen: list[Array | None] = field(default_factory=list["Array | None"])
    failed: PalpateError | None = None

    def on_tick(self, snapshot: Snapshot) -> None:
        """See `Observer`."""
        # A finished or running measurement marks a rest; each rest gets one picture.
        rests = sum(leaf.primitive == "MeasureForces" for leaf in snapshot.leaves)
        if rests > len(self.seen) and self.failed is None and snapshot.stopping is None:
            try:
                grey = (self.shoot() @ LUMA).astype(np.uint8)
            except PalpateError as error:
                self.failed = error
                return
            # A tag seen twice is ambiguous, and counts as not seen.
            corners = [where for number, where in detect(grey, self.lens) if number == self.number]
            self.seen.append(corners[0] if len(corners) == 1 else None)


def locate(
    session: CalibrationSession, source: str, intrinsics: Path | None, tag: NamedSize
) -> tuple[HandEye, CalibrationViews]:
    """Locate a camera by a tag, and put its pose into the session's robot.yaml.

    Return the fitted pose, and the views with the poses believed before.

    Raises:
        InputError: no such camera, no rough pose of it is stated, or the pictures do not fit.
        Unavailable: OpenCV is not installed, or a camera does not answer.
    """
    # Build the camera in the user's scene, or on the bench.
    number = _number(tag)
    own = scene_of_settings(session)
    scene = own or session.bench_with_camera()
    eye = _eye(session, scene, source, intrinsics, number, tag.size.value)
    # Express the believed poses of camera and tag in the frames that the fit uses: the arm's base,
    # or the hand.
    base = session.arm.stands(scene.pose_world_base)
    on_hand = eye.mount.on_hand
    mount = eye.mount if on_hand else eye.mount.within(base.inverse())
    tag_pose = base.inverse() @ _tag_pose(scene, number) if on_hand else STICKER

    # Draw candidate poses and choose those that determine the camera best.
    half, std = tag.size.value / 2, tag.size.std / tag.size.value
    scatter = session.arm.nominal.pose_repeatability
    q = configurations(session.arm)
    hands, jacobians = stances(session.arm, q)
    frame = frame_of(hands[:KEPT], jacobians[:KEPT])
    drawn = CalibrationViews(hands, jacobians, frame, half, std, eye.lens, mount, on_hand, scatter)
    session.callbacks.progress("choosing poses in view of the camera")
    chosen = _choose(session, scene, q, drawn, tag_pose)
    # Visit the poses and take a picture at each rest.
    shots = Shots(eye.shoot, eye.lens, number)
    what = "looking at tag {} from {}" if on_hand else "showing tag {} to the camera in {}"
    session.callbacks.progress(f"{what.format(number, len(chosen))} poses")
    trace = session.perform(scene, _plan(chosen), None if own else scene, shots)
    if shots.failed is not None:
        raise shots.failed
    # Use only the pictures with exactly one such tag.
    seen = [(i, where) for i, where in enumerate(shots.seen) if where is not None]
    if len(seen) < FEWEST:
        raise InputError(
            f"the camera saw tag {number} in {len(seen)} of {len(chosen)} pictures, {FEWEST} are needed: is it "
            f"{_place(on_hand)}, and the camera about where its intrinsics file says? Nothing is written"
        )
    # Fit the camera's pose to the pictures, with the joint positions measured at each rest.
    rests = np.array([trace.of(recording).q.mean(axis=0) for recording in trace.recordings])
    hands, jacobians = stances(session.arm, rests)
    session.callbacks.progress(f"fitting {len(seen)} pictures")
    shown = replace(drawn, hands=hands, jacobians=jacobians).some([i for i, _ in seen])
    eye_on_hand = hand_eye(shown, [where for _, where in seen])
    entry = _entry(eye_on_hand, eye.source, number, on_hand)
    session.config = session.config.model_copy(update={"camera": entry})
    return eye_on_hand, shown


def _place(on_hand: bool) -> str:
    """Describe the expected place of the tag."""
    if on_hand:
        return "where the scene has its site, or half a metre before the base, flat on the plane of its foot"
    return "on the hand's broad side that looks away from the base at home"


def _tag_pose(scene: Scene, number: int) -> Pose:
    """Believed pose of a fixed tag in the world."""
    stated = tags_of(scene).get(number)
    return scene.pose_world_base @ LYING if stated is None else stated.pose_world


def _number(tag: NamedSize) -> int:
    name = tag.name or "0"
    if not name.isdecimal() or int(name) >= TAGS:
        raise InputError(
            f"tag '{name[:20]}': tags are numbered 0 to {TAGS - 1}; give e.g. 0=100mm±0.1mm"
        )
    return int(name)


def _eye(
    session: CalibrationSession,
    scene: Scene,
    source: str,
    intrinsics: Path | None,
    number: int,
    side: float,
) -> Eye:
    settings = session.settings
    # A real camera needs a rough pose, from its intrinsics file.
    if not source.startswith(WORLD_CAMERA):
        stream = Stream(source, intrinsics)
        if stream.mount is None:
            raise InputError(
                "nothing says roughly where the camera is: state its pose in the intrinsics file, e.g. to 50 mm and "
                "0.1 rad: pose: {pos: …, quat: …, covariance: …}"
            )
        return Eye(source, stream.lens, stream.mount, stream.latest)
    if intrinsics is not None or settings.robot is not None:
        raise InputError(
            f"camera={source} is one of the simulated world: leave out intrinsics= and robot="
        )
    # A camera of the simulated world: on the hand, or one that its MJCF has.
    name = source.removeprefix(WORLD_CAMERA)
    cell = cell_for(settings, scene)
    assert isinstance(cell, SimulatedCell)
    if name == HAND:
        lens, mount = believed_camera(settings.seed)
        on = None if number in tags_of(scene) else cell.world.pose_world_base @ LYING
    else:
        owned = SimulatedCamera(cell.world.spec(cell.drawn), name, seed=settings.seed)
        lens, mount, on = owned.lens, owned.mount, None
    camera: list[SimulatedCamera] = []

    # Build the simulated camera on the first picture, when the world of the visit exists.
    def shoot() -> NDArray[np.uint8]:
        """Take a picture of the world in its present state, with the tag."""
        assert session.cell is not None
        footage = session.cell.footage()
        assert footage is not None
        assert footage.spec is not None
        if not camera:
            # Add the camera on the hand, or the tag on the hand, to the world.
            spec = footage.spec
            if name == HAND:
                spec = with_camera(spec, session.arm)
            if name != HAND or on is not None:
                spec = with_tag(spec, session.arm, number, side, settings.seed, on)
            camera.append(SimulatedCamera(spec, name, seed=settings.seed))
        return camera[0].shoot(footage.frames[-1][1])

    return Eye(source, lens, mount, shoot)


def _choose(
    session: CalibrationSession, scene: Scene, q: Array, drawn: CalibrationViews, tag: Pose
) -> list[Array]:
    """Choose reachable configurations of `q` (n, 7) that determine the camera's pose best, in a short order.

    `drawn` has their views of the tag, which is believed to be at the pose `tag`.
    Raises InputError: too few configurations remain.
    """
    left = select_views(drawn, tag)
    for _ in range(TRIES):
        if len(left) < FEWEST:
            break
        # Choose the most informative views, and check the plan through them.
        best = [left[i] for i in surest(drawn.some(left), tag, PICTURES)]
        chosen = _order_configurations(best, q, session.arm.home)
        findings = session.findings(scene, _plan([q[i] for i in chosen]))
        # Map each finding to its configuration: steps alternate between motion and measurement.
        steps = {int(f.path.rpartition("[")[2].rstrip("]") or 0) for f in findings if "[" in f.path}
        refused = {chosen[(step - 1) // 2] for step in steps if 0 < step <= 2 * len(chosen)}
        if not refused:
            return [q[i] for i in chosen]
        left = [i for i in left if i not in refused]
    raise InputError(
        "the arm finds no poses in which the camera sees the tag and nothing is in the way; nothing moved: is the "
        f"camera about where its intrinsics file says, and the tag {_place(drawn.on_hand)}?"
    )


def configurations(arm: RobotDescription) -> Array:
    """Draw (n, 7) configurations about home whose TCP is well above the plane of the base."""
    # Draw about home within the joint limits; a fixed seed repeats the calibration.
    random = np.random.default_rng(0)
    low, high = arm.limits.q_min + LIMIT, arm.limits.q_max - LIMIT
    spread = SPREAD * random.uniform(-1.0, 1.0, (DRAWN, len(low)))
    q = np.clip(arm.home + spread, low, high).round(4)
    places = NominalArm(arm, Pose.of([0, 0, 0]), np.zeros(3)).poses(q)
    return q[places[:, 2] > CLEAR]


def select_views(views: CalibrationViews, tag: Pose) -> list[int]:
    """Select views in which the camera should see a tag at the believed pose `tag`, at most `KEPT`.
    Return their indices."""
    lens, local = views.lens, views.local(views.camera, tag)
    # Project the tag's corners; depths below `NEAREST` are clipped and refused further down.
    pixels = lens.project(np.maximum(local, [-9, -9, NEAREST]).reshape(-1, 3))
    border = BORDER * lens.size[0]
    inside = (pixels > border) & (pixels < np.array(lens.size) - border)
    # Keep views whose corners lie within the borders and whose shortest side is large enough.
    sides = np.linalg.norm(np.diff(pixels.reshape(-1, 4, 2), axis=1), axis=2).min(axis=1)
    good = inside.reshape(-1, 8).all(axis=1) & (sides > SMALLEST)
    good &= (local[..., 2] > NEAREST).all(axis=1)
    # The corners are clockwise seen from the front: the normal must face the camera.
    across = np.cross(local[:, 3] - local[:, 0], local[:, 1] - local[:, 0])
    middle = local.mean(axis=1)
    facing = -np.einsum("ij,ij->i", across, middle)
    good &= facing > FACING * np.linalg.norm(across, axis=1) * np.linalg.norm(middle, axis=1)
    return np.flatnonzero(good)[:KEPT].tolist()


def _order_configurations(indices: list[int], q: Array, start: Array) -> list[int]:
    """Order configurations greedily: each one is the nearest to the one before."""
    left, order, at = list(indices), list[int](), start
    while left:
        nearest = min(left, key=lambda i: float(np.linalg.norm(q[i] - at)))
        order.append(nearest)
        left.remove(nearest)
        at = q[nearest]
    return order


def _plan(configurations: Sequence[Array]) -> Plan:
    """Make the plan of rests in `configurations` (7,), from home and back."""
    home = Node("MoveJoints", (("joints", HOME_CONFIG),))
    steps = [home]
    for q in configurations:
        steps.append(Node("MoveJoints", (("joints", q.tolist()),)))
        steps.append(Node("MeasureForces"))
    return calibration_plan((), Node("Sequence", children=(*steps, home)))


def _entry(hand_eye: HandEye, source: str, number: int, on_hand: bool) -> CameraConfig:
    """Make the camera's entry in robot.yaml."""
    # Field of view from the focal length: 2 atan(h / 2 f).
    pose, (width, height) = hand_eye.mount.pose_world_camera, hand_eye.lens.size
    fovy = math.degrees(2 * math.atan(height / 2 / hand_eye.lens.matrix[1, 1]))
    covariance = np.array(
        [[float(f"{part:.4e}") for part in row] for row in hand_eye.mount.covariance]
    )
    where = "that stands still" if on_hand else "on the hand"
    return CameraConfig(
        date=datetime.date.today(),
        by=f"tag {number} {where} in {len(hand_eye.corners)} pictures of {source[:80]}",
        on_hand=on_hand,
        pos=pose.position.round(6),
        quat=pose.quaternion.round(7),
        fovy=round(fovy, 5),
        size=(width, height),
        covariance=(covariance + covariance.T) / 2,
    )
