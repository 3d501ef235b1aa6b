"""An incomplete scene, and the plan that completes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from palpate.api.given import Widths, contents_of, is_text, known_keywords, planner_name
from palpate.api.plans import Plan, plan_of
from palpate.display import table
from palpate.parameter import Parameter
from palpate.planning.model.settings import ModelSettings
from palpate.planning.planner import Planner
from palpate.robots.owner.arm import own_arm
from palpate.robots.registry import DEFAULT
from palpate.scene.load import load_scene, parse_scene
from palpate.scene.poses import read_poses
from palpate.scene.remarks import remarks
from palpate.scene.scene import Scene as InnerScene
from palpate.settings import Settings, settings_of


@dataclass(frozen=True, eq=False, repr=False)
class Scene(InnerScene):
    """An incomplete simulation description, as `load` reads it.

    Attributes:
        given: what `load` was given: the file, its poses, the arm.

    The other attributes are those of `palpate.scene.scene.Scene`.
    """

    given: Settings = field(default_factory=Settings)

    @known_keywords
    def plan(
        self,
        request: str | None = None,
        planner: str | Planner = "symbolic",
        *,
        measure: str | Parameter | Sequence[str | Parameter] | None = (),
        images: Sequence[str | Path] = (),
        remeasure: bool = False,
        within: Widths | None = None,
        model_settings: ModelSettings | None = None,
    ) -> Plan:
        """Plan how to measure what the request asks and the scene does not state; check the plan.

        Args:
            request: what you want to simulate, in your words; None asks for all that is missing.
            measure: parameters by name, `"bottle.mass"`, `"bottle.*"` or `"missing"`, instead of a
                request; no language is involved. With a request, which must not ask for others, it
                decides.
            planner: `symbolic`, `exhaustive`, `replay:FILE`, `PROVIDER:MODEL`, or a planner.
            images: pictures of the workspace, for a model.
            remeasure: measure what is asked even if the scene states it.
            within: half widths of 95 % intervals to reach, `{"mass": "1g", "bottle.height": 0.001}`.
            model_settings: how a model is asked, where the planner is one.

        Returns:
            A plan. One without a tree is a rejection, and its explanation says why; what such a
            request may mean is its `proposal`: `scene.plan(measure=plan.proposal)` accepts it.

        Raises:
            InputError: a request or a planner that cannot be used.
            Unavailable: a provider out of reach.
        """
        asked = self.given.having(
            request=request,
            planner=planner_name(planner),
            measure=measure,
            images=images,
            remeasure=remeasure,
            within=within,
            model_settings=model_settings or ModelSettings(),
        )
        return plan_of(asked.checked(at_hand=True), self, planner)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on the reading: interpretations, omissions, and reasons why nothing may be
        missing."""
        return remarks(self)

    def _repr_html_(self) -> str:
        rows: list[tuple[str, ...]] = []
        for body in self.bodies.values():
            missing, known = ", ".join(sorted(body.missing)), ", ".join(sorted(body.known))
            rows.append((body.name, body.role, missing, known))
        return table(repr(self), ("body", "role", "missing", "known"), rows)


@known_keywords
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
    given = settings_of(
        scene=None if is_text(source) else source,
        poses=poses,
        arm=arm,
        cautious=cautious,
        robot_config=robot_config,
        root=root,
        robot_body=robot_body,
    )
    return load_settings(given, str(source) if is_text(source) else None)


def load_settings(given: Settings, text: str | None = None) -> Scene:
    """Read the scene that settings name, or MJCF text with the poses and the arm that they name.

    Raises:
        InputError: malformed XML, missing files, names that do not match.
    """
    arm = own_arm(given.arm, given.cautious, given.robot_config)
    robots = given.robot_body
    if text is not None:
        poses = read_poses(given.poses) if given.poses else None
        found = parse_scene(text, poses=poses, arm=arm, robot_body=robots)
    else:
        assert given.scene is not None
        found = load_scene(given.scene, given.poses, arm, root=given.root, robot_body=robots)
    return Scene(**contents_of(found, InnerScene), given=given)
