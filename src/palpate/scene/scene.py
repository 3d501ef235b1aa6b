"""D: an incomplete MJCF, read into objects, surfaces, named places and what is missing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.errors import unknown_name
from palpate.geometry.pose import Pose
from palpate.mjcf.body import Body
from palpate.mjcf.compile import refused
from palpate.parameter import Parameter
from palpate.quantities.catalogue import Catalogue
from palpate.robots.model import PREFIX

if TYPE_CHECKING:
    import mujoco

    from palpate.robots.description import RobotDescription
    from palpate.scene.resolve import ResolvedScene
    from palpate.scene.symbols import Symbols


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Scene:
    """An incomplete simulation description with the poses that came with it.

    Attributes:
        text: the user's MJCF, byte for byte as read (decoded utf-8).
        path: the file it came from, None when built from text.
        bodies: objects and surfaces by name, in document order.
        symbols: names a plan may use: poses, places, joint configurations, offsets.
        arm: what touches it; grasps, reach and `home_config` depend on it.
        pose_world_base: where the arm stands (site `robot_base`, else where the scene's own robot
            stands, else the origin).
        gravity: m/s^2, magnitude.
        priors: what is believed of every missing quantity before it is measured.
        resolved: the file it was read from, which can be completed: for `spec` and the twin.
        refit: of a scene seen in a picture: the scene anew, when contact has told a surface's
            height (m).
        rises: surfaces whose height was measured, and what stands on them, to the m by which each is
            higher than the scene was given.
        as_given: the scene before any height was measured; None where it is that one.
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
    """Static bodies that carry things."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "objects", self._of("object"))
        object.__setattr__(self, "surfaces", self._of("surface"))

    def _of(self, role: str) -> dict[str, Body]:
        return {name: body for name, body in self.bodies.items() if body.role == role}

    def __repr__(self) -> str:
        counted = [
            _counted(len(self.objects), "object"),
            _counted(len(self.surfaces), "surface"),
            f"{len(self.missing)} missing",
        ]
        return f"<Scene '{self.name}': {', '.join(counted)}>"

    def __str__(self) -> str:
        lines = [repr(self)]
        for body in self.bodies.values():
            missing = ", ".join(sorted(body.missing)) or "nothing"
            lines.append(f"  {body.role} {body.name}: {missing} missing")
        return "\n".join(lines)

    @property
    def name(self) -> str:
        """The file's, else the one that the MJCF gives itself."""
        if self.path is not None:
            return self.path.stem
        return self.resolved.document.root.get("model") or "scene"

    @property
    def catalogue(self) -> Catalogue:
        """The quantities it was read for."""
        return self.resolved.catalogue

    @property
    def files(self) -> tuple[Path, ...]:
        """Every other file the MJCF needs (includes, meshes, textures), absolute."""
        return self.resolved.document.files

    def body(self, name: str) -> Body:
        """The object or surface named `name`.

        Raises:
            InputError: there is none; the message lists those there are.
        """
        if name not in self.bodies:
            raise unknown_name("object or surface", name, self.bodies)
        return self.bodies[name]

    @property
    def missing(self) -> tuple[Parameter, ...]:
        """Everything the MJCF does not state, in document order ("everything missing")."""
        found: list[Parameter] = []
        for body in self.bodies.values():
            ids = [id for id in self.catalogue if id in body.missing]
            found += [Parameter(body.name, id) for id in ids]
        return tuple(found)

    def spec(self, values: Mapping[Parameter, tuple[float, ...]] | None = None) -> mujoco.MjSpec:
        """The scene as an editable model without any robot, unknowns filled from `values`, else
        from priors."""
        return self.resolved.spec(values or {})

    def spec_with(self, robot: mujoco.MjSpec) -> mujoco.MjSpec:
        """The scene as a model with a robot at its base, to look at: nothing is simulated in it.

        Raises:
            InputError: the scene does not take the robot in.
        """
        spec = self.spec()
        for key in list(spec.keys):
            spec.delete(key)
        base = self.pose_world_base
        frame = spec.worldbody.add_frame(pos=base.position, quat=base.quaternion)
        # Options are of no use here; where the two differ MuJoCo would warn.
        for name in ("timestep", "integrator", "cone", "impratio", "gravity"):
            setattr(robot.option, name, getattr(spec.option, name))
        try:
            spec.attach(robot, frame=frame, prefix=PREFIX)
        except ValueError as error:
            raise refused(error) from None
        return spec


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def with_real_arm(scene: Scene) -> Scene:
    """The scene with an arm in it that is not simulated."""
    return replace(scene, arm=scene.arm.real())
