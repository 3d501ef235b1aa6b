"""An incomplete scene, and the plan that completes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from palpate.api.given import Widths, contents_of, is_text, names, path_of, paths_of, planner_name
from palpate.api.plans import Plan, plan_of
from palpate.display import table
from palpate.planning.model.settings import ModelSettings
from palpate.planning.planner import Planner
from palpate.quantities.within import Within
from palpate.robots.owner.registered import own_arm
from palpate.robots.registry import DEFAULT
from palpate.scene.load import load_scene, parse_scene
from palpate.scene.poses import read_poses
from palpate.scene.remarks import remarks
from palpate.scene.scene import Scene as InnerScene
from palpate.settings import Settings


@dataclass(frozen=True, eq=False, repr=False)
class Scene(InnerScene):
    """An incomplete simulation description, as `load` reads it.

    Attributes:
        poses_file: the `poses.yaml` that came with it.
        arm_name, cautious, robot_config, root, robot_body: as `load` was told.

    Else as `palpate.scene.scene.Scene`.
    """

    poses_file: Path | None = None
    arm_name: str = DEFAULT
    cautious: bool = False
    robot_config: Path | None = None
    root: Path | None = None
    robot_body: tuple[str, ...] = ()

    def plan(
        self,
        request: str | None = None,
        planner: str | Planner = "symbolic",
        *,
        images: Sequence[str | Path] = (),
        remeasure: bool = False,
        within: Widths | None = None,
        model_settings: ModelSettings | None = None,
    ) -> Plan:
        """A checked plan that measures what the request asks and the scene does not know.

        Args:
            request: what you want to simulate, in your words; None asks for all that is missing.
            planner: `symbolic`, `exhaustive`, `replay:FILE`, `PROVIDER:MODEL`, or a planner.
            images: pictures of the workspace, for a model.
            remeasure: measure what is asked even if the scene states it.
            within: half widths of 95 % intervals to reach, `{"mass": "1g", "bottle.height": 0.001}`.
            model_settings: how a model is asked, where the planner is one.

        Returns:
            A plan. One without a tree is a rejection, and its explanation says why.

        Raises:
            InputError: a request or a planner that cannot be used.
            Unavailable: a provider out of reach.
        """
        asked = Settings(
            request=request,
            images=paths_of(images),
            planner=planner_name(planner),
            remeasure=remeasure,
            within=Within.read(within or {}),
            model_settings=model_settings or ModelSettings(),
        )
        return plan_of(self.settings(asked), self, planner)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on the reading: interpretations, omissions, and reasons why nothing may be
        missing."""
        return remarks(self)

    def settings(self, asked: Settings) -> Settings:
        """Settings for a request about this scene.

        Raises:
            InputError: a value out of range.
        """
        mine = replace(
            asked,
            scene=self.path,
            poses=self.poses_file,
            arm=self.arm_name,
            cautious=self.cautious,
            robot_config=self.robot_config,
            root=self.root,
            robot_body=self.robot_body,
        )
        return mine.checked(at_hand=True)

    def _repr_html_(self) -> str:
        rows: list[tuple[str, ...]] = []
        for body in self.bodies.values():
            missing, known = ", ".join(sorted(body.missing)), ", ".join(sorted(body.known))
            rows.append((body.name, body.role, missing, known))
        return table(repr(self), ("body", "role", "missing", "known"), rows)


def load(
    source: str | Path,
    poses: str | Path | None = None,
    arm: str | Path = DEFAULT,
    cautious: bool = False,
    robot_config: str | Path | None = None,
    root: str | Path | None = None,
    robot_body: str | Sequence[str] = (),
) -> Scene:
    """Read an incomplete MJCF.

    Args:
        source: a file, or MJCF text (which then begins with `<`).
        poses: `poses.yaml`: where objects and named places are.
        arm: the arm that is to touch it: a name, or the folder of a description.
        cautious: the arm is to move slowly everywhere, for what no scene shows.
        robot_config: `robot.yaml`: what was measured of this very arm.
        root: the folder outside of which none of the scene's files is read; by default the
            nearest common folder of the scene and all that it refers to, where that is no whole home,
            folder of the system or file system's root.
        robot_body: the body that the scene's own robot begins with, or several, or `none`; by
            default what actuators drive, or ends in a hand. The arm takes its place.

    Raises:
        InputError: malformed XML, missing files, names that do not match.
    """
    file, config = path_of(poses), path_of(robot_config)
    description = own_arm(str(arm), cautious, config)
    robots = names(robot_body)
    if is_text(source):
        entries = read_poses(file) if file is not None else None
        found = parse_scene(str(source), poses=entries, arm=description, robot_body=robots)
    else:
        path = Path(source)
        found = load_scene(path, file, description, root=path_of(root), robot_body=robots)
    return Scene(
        **contents_of(found, InnerScene),
        poses_file=file,
        arm_name=str(arm),
        cautious=cautious,
        robot_config=config,
        root=path_of(root),
        robot_body=robots,
    )
