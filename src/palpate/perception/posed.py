"""Workplace at its believed poses: the scene with the nominal arm at measured joint angles.

It is a visualisation. It contains no deviations of the hidden world or of a real workplace.
"""

from __future__ import annotations

import mujoco
import numpy as np

from palpate.common.pose import Array, Pose
from palpate.mjcf.compile import compile_model
from palpate.perception.film import Footage
from palpate.robots.description import PREFIX
from palpate.scene.scene import Scene
from palpate.trace.samples import Trace

FRAME_PERIOD = 1.0 / 30.0  # s. Period of replay frames, as of the simulated camera.


class PosedCell:
    """Scene and arm, with every object at its last release pose.

    Attributes:
        spec: source of the model.
        model: the compiled model.
        data: state of the model, with all body poses after `show`.
    """

    def __init__(self, scene: Scene) -> None:
        self.spec = scene.spec_with(scene.arm.spec())
        self.model = model = compile_model(self.spec)
        self.data = mujoco.MjData(model)
        arm = scene.arm
        # qpos addresses of the arm's joints, the fingers, and the objects with a free joint.
        self._arm = [int(model.joint(PREFIX + name).qposadr[0]) for name in arm.joints]
        self._fingers = [int(model.joint(PREFIX + name).qposadr[0]) for name in arm.hand.fingers]
        self._bodies: dict[str, int] = {}
        for name in scene.objects:
            body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
            joint = int(model.body_jntadr[body]) if body > 0 else -1
            if joint >= 0 and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
                self._bodies[name] = int(model.jnt_qposadr[joint])
        # Objects start at their scene poses.
        self._initial = {name: scene.bodies[name].pose_world for name in self._bodies}
        self.put_back()

    def put_back(self) -> None:
        """Return all objects to their scene poses, with an empty hand."""
        self._poses = dict(self._initial)
        self._held: tuple[str, Pose] | None = None

    def show(self, q: Array, width: float, pose_world_tcp: Pose, holding: str | None) -> None:
        """Set the poses of the arm at `q` (7,), rad, of fingers `width` m apart, and of objects.

        The object `holding` between the fingers moves with them.
        """
        self.carry(pose_world_tcp, holding)
        self.data.qpos[self._arm] = q
        self.data.qpos[self._fingers] = width / 2
        for name, address in self._bodies.items():
            self.data.qpos[address : address + 7] = self._poses[name].vector
        mujoco.mj_kinematics(self.model, self.data)

    def carry(self, pose_world_tcp: Pose, holding: str | None) -> None:
        """Move the hand: a held object keeps its pose in the hand, a released one its world pose."""
        if holding not in self._poses:
            self._held = None
            return
        # A new grasp: store the pose of the object in the hand.
        if self._held is None or self._held[0] != holding:
            self._held = (holding, pose_world_tcp.inverse() @ self._poses[holding])
        self._poses[holding] = pose_world_tcp @ self._held[1]


class Replay:
    """Replay of a trace in a posed cell; a step back in time restarts from the beginning."""

    def __init__(self, cell: PosedCell, trace: Trace) -> None:
        self._cell, self._trace = cell, trace
        self._begin()

    def _begin(self) -> None:
        self._now, self._ended = -np.inf, 0
        self._holding: str | None = None
        self._cell.put_back()

    def show(self, t: float) -> None:
        """Set all poses to those at robot time `t`, s."""
        if t < self._now:
            self._begin()
        self._now = t
        # Apply all leaves that ended since the last call; grasps change at the end of a leaf.
        leaves = self._trace.leaves
        while self._ended < len(leaves) and leaves[self._ended].end <= t:
            leaf = leaves[self._ended]
            self._ended += 1
            if leaf.context is not None and leaf.context.holding != self._holding:
                # A grasp or release: carry the old object to this pose, and the new one from it.
                for holding in (self._holding, leaf.context.holding):
                    self._cell.carry(self._tcp(leaf.end), holding)
                self._holding = leaf.context.holding
        # Arm and fingers at the sample of this time.
        samples, row = self._trace.samples, self._row(t)
        self._cell.show(samples.q[row], float(samples.width[row]), self._tcp(t), self._holding)

    def _row(self, t: float) -> int:
        return min(int(np.searchsorted(self._trace.t, t)), len(self._trace.t) - 1)

    def _tcp(self, t: float) -> Pose:
        x = self._trace.samples.pose_world_tcp[self._row(t)]
        return Pose.of(x[:3], x[3:])


def played_again(scene: Scene, trace: Trace) -> Footage:
    """Replay a trace as camera footage, with everything at its believed pose."""
    # Sample the replay at the frame period of the camera.
    cell = PosedCell(scene)
    replay = Replay(cell, trace)
    frames: list[tuple[float, Array]] = []
    for t in np.arange(trace.t[0], trace.t[-1], FRAME_PERIOD).tolist():
        replay.show(t)
        frames.append((t, cell.data.qpos.copy()))
    return Footage(cell.model, tuple(frames), cell.spec, believed=True)
