"""What a robot's states say of it."""

from __future__ import annotations

import numpy as np

from palpate.common.pose import Array

from .believed import GRAVITY, BelievedArm
from .control import Controller
from .sensing import Sensing
from .watch import Watch
from .wire import ControllerMode, MotionMode, RobotMode, StateBuffer

CARTESIAN = (MotionMode.CARTESIAN_POSITION, MotionMode.CARTESIAN_VELOCITY)
"""Motions of the end effector."""


class Teller:
    """Writes the state of one arm.

    Attributes:
        state: what is sent. felt: (13,) N m, N, N m, how much acts on the joints and in the
            stiffness frame.
    """

    def __init__(
        self, believed: BelievedArm, sensing: Sensing, controller: Controller, watch: Watch
    ) -> None:
        self._believed, self._sensing, self._controller = believed, sensing, controller
        self._watch = watch
        self.state, self.felt, self._before = StateBuffer(), np.zeros(13), np.zeros(7)
        self.configured()

    def configured(self) -> None:
        """Tell what is set."""
        fields, believed = self.state.fields, self._believed
        for name in ("F_T_NE", "NE_T_EE", "F_T_EE", "EE_T_K"):
            fields[name][:] = getattr(believed, name).T.ravel()
        for name, body in (("ee", believed.ee), ("load", believed.load)):
            fields[f"m_{name}"][:] = body.mass
            fields[f"F_x_C{name}"][:] = body.centre
            fields[f"I_{name}"][:] = body.inertia.ravel()
        fields["O_ddP_O"][:] = (0.0, 0.0, -GRAVITY)

    def feel(self) -> None:
        """After a cycle: what acts on the arm from outside."""
        fields, felt = self.state.fields, self.felt
        believed, external = self._believed, self._sensing.external
        wrench, turn = believed.wrench(external), believed.O_T_K[:3, :3]
        fields["tau_ext_hat_filtered"][:] = felt[:7] = external
        fields["O_F_ext_hat_K"][:] = wrench
        felt[7:10], felt[10:] = wrench[:3] @ turn, wrench[3:] @ turn
        fields["K_F_ext_hat_K"][:] = felt[7:]
        np.abs(felt, out=felt)

    def tell(
        self,
        number: int,
        mode: RobotMode,
        motion: MotionMode,
        controls: ControllerMode,
        torque: Array,
        rate: float,
    ) -> None:
        """Write the state of the cycle `number`; desired torques (7,), N m; `rate` of success."""
        generated = motion not in (MotionMode.IDLE, MotionMode.NONE)
        self._tell_joints(generated, generated or mode is not RobotMode.MOVE)
        self._tell_pose(motion in CARTESIAN)
        fields, sensing, felt = self.state.fields, self._sensing, self.felt
        fields["dtau_J"][:] = (sensing.tau - self._before) * 1e3
        fields["tau_J"][:] = self._before = sensing.tau
        fields["tau_J_d"][:] = torque
        phase = self._watch.phase(motion)
        touched, hit = felt > self._watch.lower[phase], felt > self._watch.upper[phase]
        fields["joint_contact"][:], fields["cartesian_contact"][:] = touched[:7], touched[7:]
        fields["joint_collision"][:], fields["cartesian_collision"][:] = hit[:7], hit[7:]
        self.state.put(number, motion, controls, mode, rate)

    def _tell_joints(self, generated: bool, held: bool) -> None:
        """`generated`: by a motion generator. `held`: by the arm's own controller."""
        fields, sensing, desired = self.state.fields, self._sensing, self._controller.desired
        fields["q"][:] = fields["theta"][:] = sensing.q
        fields["dq"][:] = fields["dtheta"][:] = sensing.dq
        fields["q_d"][:] = desired.q if held else sensing.q
        fields["dq_d"][:] = desired.dq if generated else 0.0
        fields["ddq_d"][:] = desired.ddq if generated else 0.0
        for name, angles in (("elbow", sensing.q), ("elbow_d", desired.q), ("elbow_c", desired.q)):
            fields[name][:] = (angles[2], -1.0 if angles[3] < 0 else 1.0)

    def _tell_pose(self, generated: bool) -> None:
        fields, controller = self.state.fields, self._controller
        pose = self._believed.O_T_EE.T.ravel()
        fields["O_T_EE"][:] = pose
        fields["O_T_EE_d"][:] = controller.target.T.ravel() if generated else pose
        fields["O_T_EE_c"][:] = fields["O_T_EE_d"]
        if generated:
            fields["O_dP_EE_c"][:] = fields["O_dP_EE_d"][:] = controller.twist
            fields["O_ddP_EE_c"][:] = controller.acceleration
