"""The workplace as it is believed to be, posed: D with the nominal arm in it, at measured joint angles.

It is a picture for people. What the hidden world, or a real workplace, does otherwise is not in it.
"""

from __future__ import annotations

import mujoco
import numpy as np

from palpate.geometry.pose import Array, Pose
from palpate.mjcf.compile import compile_model
from palpate.pictures.footage import Footage
from palpate.robots.model import PREFIX
from palpate.scene.scene import Scene
from palpate.trace.samples import Trace

FRAME_PERIOD = 1.0 / 30.0
"""s between two frames of what is played again, as of the simulated camera."""


class PosedCell:
    """D and the arm, and where everything is after what has been grasped and let go of so far.

    Attributes:
        spec: what the model was compiled from.
        model, data: of MuJoCo; `data` has the poses of all bodies after `show`.
    """

    def __init__(self, scene: Scene) -> None:
        self.spec = scene.spec_with(scene.arm.spec())
        self.model = compile_model(self.spec)
        self.data = mujoco.MjData(self.model)
        self._arm = [self._address(name) for name in scene.arm.joints]
        self._fingers = [self._address(name) for name in scene.arm.hand.fingers]
        self._bodies = self._free_bodies(scene)
        self._at_first = {name: scene.bodies[name].pose_world for name in self._bodies}
        self.put_back()

    def put_back(self) -> None:
        """Put everything where D has it; the hand is empty."""
        self._poses = dict(self._at_first)
        self._held: tuple[str, Pose] | None = None

    def show(self, q: Array, width: float, pose_world_tcp: Pose, holding: str | None) -> None:
        """Pose everything.

        Args:
            q: (7,) rad.
            width: m between the fingers.
            pose_world_tcp: where the TCP is.
            holding: the object between the fingers, which moves along with them.
        """
        self.carry(pose_world_tcp, holding)
        self.data.qpos[self._arm] = q
        self.data.qpos[self._fingers] = width / 2
        for name, address in self._bodies.items():
            pose = self._poses[name]
            self.data.qpos[address : address + 7] = pose.vector
        mujoco.mj_kinematics(self.model, self.data)

    def carry(self, pose_world_tcp: Pose, holding: str | None) -> None:
        """Move the hand: what it holds keeps its pose in it; what it let go of stays where it is."""
        if holding not in self._poses:
            self._held = None
            return
        if self._held is None or self._held[0] != holding:
            self._held = (holding, pose_world_tcp.inverse() @ self._poses[holding])
        self._poses[holding] = pose_world_tcp @ self._held[1]

    def _address(self, joint: str) -> int:
        """Address of a joint of the arm in qpos."""
        return int(self.model.joint(PREFIX + joint).qposadr[0])

    def _free_bodies(self, scene: Scene) -> dict[str, int]:
        """Addresses of the free objects' poses in qpos."""
        found: dict[str, int] = {}
        for name in scene.objects:
            body = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, name)
            joint = int(self.model.body_jntadr[body]) if body > 0 else -1
            if joint >= 0 and self.model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
                found[name] = int(self.model.jnt_qposadr[joint])
        return found


class Replay:
    """A trace in a posed cell: everything where it was at a time. Going forward is quick, going back
    begins anew.

    Args:
        cell: what is posed.
        trace: what is played.
    """

    def __init__(self, cell: PosedCell, trace: Trace) -> None:
        self._cell, self._trace = cell, trace
        self._begin()

    def show(self, t: float) -> None:
        """Pose everything as it was at robot time `t`, s."""
        if t < self._now:
            self._begin()
        self._now = t
        leaves = self._trace.leaves
        while self._ended < len(leaves) and leaves[self._ended].end <= t:
            leaf = leaves[self._ended]
            self._ended += 1
            if leaf.context is not None and leaf.context.holding != self._holding:
                self._cell.carry(self._tcp(leaf.end), self._holding)
                self._holding = leaf.context.holding
                self._cell.carry(self._tcp(leaf.end), self._holding)
        samples, row = self._trace.samples, self._row(t)
        self._cell.show(samples.q[row], float(samples.width[row]), self._tcp(t), self._holding)

    def _begin(self) -> None:
        self._now, self._ended = -np.inf, 0
        self._holding: str | None = None
        self._cell.put_back()

    def _row(self, t: float) -> int:
        return min(int(np.searchsorted(self._trace.t, t)), len(self._trace.t) - 1)

    def _tcp(self, t: float) -> Pose:
        x = self._trace.samples.pose_world_tcp[self._row(t)]
        return Pose.of(x[:3], x[3:])


def played_again(scene: Scene, trace: Trace) -> Footage:
    """Replay of a trace for a camera: everything at its believed pose."""
    cell = PosedCell(scene)
    replay = Replay(cell, trace)
    frames: list[tuple[float, Array]] = []
    for t in np.arange(trace.t[0], trace.t[-1], FRAME_PERIOD).tolist():
        replay.show(t)
        frames.append((t, cell.data.qpos.copy()))
    return Footage(cell.model, tuple(frames), cell.spec, believed=True)
