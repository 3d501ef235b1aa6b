"""D with an arm in it, compiled to look at where everything is; nothing is simulated in it."""

from __future__ import annotations

import mujoco

from palpate.mjcf.compile import compile_model, refused
from palpate.robots.model import PREFIX
from palpate.scene.scene import Scene


def compiled_with(scene: Scene, robot: mujoco.MjSpec) -> mujoco.MjModel:
    """The scene, with a robot at its base.

    Raises:
        InputError: the scene does not compile with the robot in it.
    """
    return compile_model(armed(scene, robot))


def armed(scene: Scene, robot: mujoco.MjSpec) -> mujoco.MjSpec:
    """The same, before it is compiled.

    Raises:
        InputError: the scene does not take the robot in.
    """
    spec = scene.spec()
    for key in list(spec.keys):
        spec.delete(key)
    base = scene.pose_world_base
    frame = spec.worldbody.add_frame(pos=base.position, quat=base.quaternion)
    # Options are of no use here; where the two differ MuJoCo would warn.
    for name in ("timestep", "integrator", "cone", "impratio", "gravity"):
        setattr(robot.option, name, getattr(spec.option, name))
    try:
        spec.attach(robot, frame=frame, prefix=PREFIX)
    except ValueError as error:
        raise refused(error) from None
    return spec
