"""D: an incomplete MJCF, read into objects, surfaces, named poses and missing parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.common.errors import unknown_name
from palpate.common.parameter import Parameter
from palpate.common.pose import Pose
from palpate.estimation.quantities.catalogue import Catalogue
from palpate.mjcf.body import Body
from palpate.mjcf.compile import compile_error
from palpate.robots.description import PREFIX, RobotDescription
from palpate.scene.resolve import ResolvedScene
from palpate.scene.symbols import Symbols

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, slots=True, eq=False, repr=False, weakref_slot=True)
class Scene:
    """An incomplete simulation description, and the poses given with it.

    Attributes:
        text: the user's MJCF, byte for byte as read (decoded utf-8).
        path: its file, None if built from text.
        bodies: objects, surfaces and fixtures by name, in document order.
        symbols: names a plan may use: poses, places, joint configurations, offsets.
        arm: arm of the plans; grasps, reach and `home_config` depend on it.
        pose_world_base: pose of the arm's base (site `robot_base`, else that of the scene's own
            robot, else the origin).
        gravity: magnitude, m/s^2.
        priors: prior mean of every missing quantity.
        resolved: the file with beliefs, for `spec` and the twin.
        refit: fits a scene from a picture again to the measured height of a surface, m; else None.
        rises: height minus given height, m, of each measured surface and of the bodies on it.
        as_given: the scene before any height was measured; None if it is this one.
    """

    text: str
    path: Path | None
    bodies: Mapping[str, Body]
    symbols: Symbols
    arm: RobotDescription
    pose_world_base: Pose
    gravity: float
    priors: Mapping[Parameter, tuple[float, ...]]
    resolved: ResolvedScene
    refit: Callable[[str, float], Scene] | None = None
    rises: Mapping[str, float] = field(default_factory=dict[str, float])
    as_given: Scene | None = None

    objects: Mapping[str, Body] = field(init=False)
    """Bodies with a free joint."""
    surfaces: Mapping[str, Body] = field(init=False)
    """Static bodies with a level top that can carry objects."""
    fixtures: Mapping[str, Body] = field(init=False)
    """Bodies with a slide or hinge joint: drawers, doors, windows."""

    def __post_init__(self) -> None:
        # Views by role, computed once, as the scene is immutable.
        for role in ("object", "surface", "fixture"):
            chosen = {name: body for name, body in self.bodies.items() if body.role == role}
            object.__setattr__(self, f"{role}s", chosen)

    def __repr__(self) -> str:
        # Fixtures are mentioned only if there are any.
        counts = [(len(self.objects), "object"), (len(self.surfaces), "surface")]
        counts += [(len(self.fixtures), "fixture")] if self.fixtures else []
        counted = [f"{number} {noun}{'s' * (number != 1)}" for number, noun in counts]
        return f"<Scene '{self.name}': {', '.join(counted)}, {len(self.missing)} missing>"

    def __str__(self) -> str:
        lines = [repr(self)]
        for body in self.bodies.values():
            missing = ", ".join(sorted(body.missing)) or "nothing"
            lines.append(f"  {body.role} {body.name}: {missing} missing")
        return "\n".join(lines)

    @property
    def name(self) -> str:
        """Name of the file, else of the MJCF's model."""
        if self.path is not None:
            return self.path.stem
        return self.resolved.document.root.get("model") or "scene"

    @property
    def catalogue(self) -> Catalogue:
        return self.resolved.catalogue

    @property
    def files(self) -> tuple[Path, ...]:
        """Every other file the MJCF needs (includes, meshes, textures), absolute."""
        return self.resolved.document.files

    @property
    def body_poses(self) -> dict[str, Pose]:
        """World pose of each body's frame, by name."""
        return {name: body.pose_world for name, body in self.bodies.items()}

    def body(self, name: str) -> Body:
        """Return the object, surface or fixture `name`; the error for an unknown one lists the valid ones."""
        if name not in self.bodies:
            raise unknown_name("object or surface", name, self.bodies)
        return self.bodies[name]

    @property
    def missing(self) -> tuple[Parameter, ...]:
        """All parameters that the MJCF does not state, in document order."""
        parameters: list[Parameter] = []
        for body in self.bodies.values():
            # The order of the catalogue is the order within a body.
            ids = [id for id in self.catalogue if id in body.missing]
            parameters += [Parameter(body.name, id) for id in ids]
        return tuple(parameters)

    def spec(self, values: Mapping[Parameter, tuple[float, ...]] | None = None) -> mujoco.MjSpec:
        """The scene as an editable model without any robot; unknowns are from `values`, else from the priors."""
        return self.resolved.spec(values or {})

    def spec_with(self, robot: mujoco.MjSpec) -> mujoco.MjSpec:
        """The scene as a model with a robot at its base, for pictures and not for simulation."""
        spec = self.spec()
        # Keyframes do not fit a model with further joints.
        for key in list(spec.keys):
            spec.delete(key)
        base = self.pose_world_base
        # The robot is attached at a frame of the world at its base.
        frame = spec.worldbody.add_frame(pos=base.position, quat=base.quaternion)
        # Options have no effect on pictures, but MuJoCo warns where the two differ.
        for name in ("timestep", "integrator", "cone", "impratio", "gravity"):
            setattr(robot.option, name, getattr(spec.option, name))
        try:
            spec.attach(robot, frame=frame, prefix=PREFIX)
        except ValueError as error:
            raise compile_error(error) from None
        return spec


def with_real_arm(scene: Scene) -> Scene:
    """The scene with the real arm in place of the simulated one."""
    return replace(scene, arm=scene.arm.real())
