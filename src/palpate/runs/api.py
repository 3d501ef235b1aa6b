"""The public API: load a scene, plan, and run, or all at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from palpate.common.display import table
from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.common.processes import single_threaded_blas
from palpate.execution.cell import Cell
from palpate.execution.recovery import OnFailure
from palpate.planning.check.finding import Finding
from palpate.planning.model.settings import ModelSettings
from palpate.planning.plan import Plan as InnerPlan
from palpate.planning.planner import Planner
from palpate.robots.noise_levels import DEFAULT_LEVEL
from palpate.robots.owner import DEFAULT, own_arm
from palpate.runs import pipeline
from palpate.runs.callbacks import Confirm, Progress, RunCallbacks, allow, ignore
from palpate.runs.run import Run as InnerRun
from palpate.runs.settings import Settings, settings_of
from palpate.runs.stored import (
    Run,
    Widths,
    contents_of,
    is_file,
    is_text,
    known_keywords,
    planner_name,
    run_of,
)
from palpate.scene.load import parse_scene
from palpate.scene.poses import read_poses
from palpate.scene.remarks import remarks
from palpate.scene.scene import Scene as InnerScene
from palpate.scene.scene import with_real_arm

if TYPE_CHECKING:
    from palpate.execution.runner import Observer


@dataclass(frozen=True, repr=False)
class Plan(InnerPlan):
    """A plan: parameters, explanation and behavior tree.

    `Scene.plan` returns a checked plan, which can be run. A user's own planner may construct one.
    """

    # The run so far: settings, scene, this plan and its findings. None before the check.
    begun: InnerRun | None = field(default=None, kw_only=True, compare=False)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings of the check; a plan with findings is not executed."""
        return self.run_so_far.findings

    @property
    def run_so_far(self) -> InnerRun:
        """The run so far. Raises InputError: the plan was not checked against a scene."""
        if self.begun is None:
            raise InputError("this plan is not checked against a scene yet: Scene.plan does that")
        return self.begun

    @known_keywords
    def run(
        self,
        cell: Cell | None = None,
        *,
        world: str | Path | InnerScene | None = None,
        robot: str | None = None,
        noise: str = DEFAULT_LEVEL,
        seed: int = 0,
        on_failure: OnFailure = "stop",
        rehearse: bool | None = None,
        within: Widths | None = None,
        fast: bool = False,
        confirm: Confirm = allow,
        observer: Observer | None = None,
        progress: Progress = ignore,
        out: str | Path | None = None,
    ) -> Run:
        """Execute the plan, estimate, and build the twin.

        Args:
            cell: the workplace; None makes the one that the next arguments describe.
            world: MJCF of the hidden simulated world (a file, its text, or a scene); None simulates
                the plan's scene with its unknowns drawn from priors.
            robot: URL of a real robot.
            noise: noise model of the simulated robot, a name or a FILE.yaml.
            seed: of everything random in it.
            on_failure: reaction to a failed action: `stop`, `skip` or `replan`.
            rehearse: execute in simulation first; None means before a real robot moves, and for
                plans of models, files and own planners. False is for the embedded arm only.
            within: half widths of 95 % intervals to reach; None keeps those of the plan.
            fast: leave out film and replay in the twin, which take longest and measure nothing.
            confirm: called with the run before a real robot moves; True allows the motion.
            observer: watches every tick.
            progress: called with the name of each stage, e.g. `print`.
            out: folder to write the run to, while it grows; must not exist.

        Returns:
            The finished run. If the plan has no tree, or findings, nothing moves and the status is
            `rejected`. Failures after the first motion are in `shortfalls`. A Ctrl-C is in
            `interrupted`.

        Raises:
            InputError: bad input.
            Unavailable: no such robot.
            ExecutionAborted: not confirmed, or interrupted before anything moved.
        """
        # A world that is given as a scene becomes a cell.
        begun = self.run_so_far
        world = hidden_world(world, begun.settings)
        if isinstance(world, InnerScene):
            from palpate.execution.simulated_cell import simulated_cell

            cell = simulated_cell(begun.scene, world, noise=noise, seed=seed)
            world = world.path
        # Complete the settings of the plan with those of the execution.
        settings = begun.settings.having(
            world=world,
            robot=robot,
            noise=noise,
            seed=seed,
            on_failure=on_failure,
            rehearse=rehearse,
            within=begun.settings.within if within is None else within,
            fast=fast,
            out=out,
        ).check_values(at_hand=True)
        run = replace(begun, settings=settings)
        if robot is not None:
            pipeline.preflight(settings)
            run = replace(run, scene=with_real_arm(run.scene))
        callbacks = RunCallbacks(observer, progress, confirm)
        with single_threaded_blas():
            return run_of(pipeline.carry_out(run, callbacks, cell, settings.out))

    def _repr_html_(self) -> str:
        rows = [(line,) for line in str(self).splitlines()[1:]]
        return table(repr(self), ("tree",), rows)


def hidden_world(
    world: str | Path | InnerScene | None, settings: Settings
) -> Path | InnerScene | None:
    """Return the simulated world as given; parse MJCF text."""
    if is_text(world):
        return parse_scene(str(world), arm=own_arm(settings.arm, settings.cautious, None))
    return Path(world) if isinstance(world, str) else world


def plan_of(run: InnerRun) -> Plan:
    """Make the public object of the plan of a run that begins."""
    return Plan(**contents_of(run.plan, InnerPlan), begun=run)


# An incomplete scene, and the plan that completes it.


@dataclass(frozen=True, eq=False, repr=False)
class Scene(InnerScene):
    """An incomplete simulation description, read by `load`.

    Attributes:
        given: arguments of `load`: the file, its poses, the arm.

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
        """Plan the measurement of everything that the request asks and the scene does not state; check the plan.

        Args:
            request: what you want to simulate, in your words; None asks for everything missing.
            measure: parameters by name, `"bottle.mass"`, `"bottle.*"` or `"missing"`, instead of a
                request; no language is involved. A request in addition must not ask for others.
            planner: `symbolic`, `exhaustive`, `replay:FILE`, `PROVIDER:MODEL`, or a planner.
            images: pictures of the workspace, for a model.
            remeasure: measure requested quantities even if the scene states them.
            within: half widths of 95 % intervals to reach, `{"mass": "1g", "bottle.height":
                0.001}`.
            model_settings: settings of the requests, if the planner is a model.

        Returns:
            A plan. A plan without a tree is a rejection, and its explanation gives the reason. Its
            `proposal` is a possible meaning of the request: `scene.plan(measure=plan.proposal)`
            accepts it.

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
        asked = asked.check_values(at_hand=True)
        return plan_of(pipeline.plan(asked, self, None if isinstance(planner, str) else planner))

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on the reading: interpretations, omissions, and reasons why nothing may be missing."""
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
        poses: `poses.yaml`: poses of objects and named places.
        arm: the arm that touches the scene: a name, or the folder of a description.
        cautious: the arm moves slowly everywhere, because of obstacles that the scene lacks.
        robot_config: `robot.yaml`: calibration of this very arm.
        root: folder of all files of the scene; no file outside it is read. By default it is the
            nearest common folder of the scene and the files that it refers to. A home, a system
            folder and the file system's root are never taken by default.
        robot_body: root bodies of the scene's own robot, or `none`. By default these are bodies
            that actuators drive or that end in a hand. The arm replaces them.

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
    """Read the scene that settings name, or MJCF text with the poses and the arm that they name."""
    arm = own_arm(given.arm, given.cautious, given.robot_config)
    robots = given.robot_body
    if text is not None:
        poses = read_poses(given.poses) if given.poses else None
        scene = parse_scene(text, poses=poses, arm=arm, robot_body=robots)
    else:
        scene = given.read_scene(arm)
    return Scene(**contents_of(scene, InnerScene), given=given)


# A run of all stages in one call, from a scene or from settings.


class Options(TypedDict, total=False):
    """All arguments of `load`, `Scene.plan` and `Plan.run`."""

    poses: str | Path | None
    camera: str | int | None
    intrinsics: str | Path | None
    pose_estimator: str | None
    arm: str | Path
    cautious: bool
    robot_config: str | Path | None
    root: str | Path | None
    robot_body: str | Sequence[str]
    measure: str | Parameter | Sequence[str | Parameter] | None
    images: Sequence[str | Path]
    remeasure: bool
    within: Widths | None
    model_settings: ModelSettings | None
    cell: Cell | None
    world: str | Path | InnerScene | None
    robot: str | None
    noise: str
    seed: int
    on_failure: OnFailure
    rehearse: bool | None
    fast: bool
    confirm: Confirm
    observer: Observer | None
    progress: Progress
    out: str | Path | None


@partial(known_keywords, more=Options.__annotations__)
def run(
    scene: str | Path | Scene | None = None,
    request: str | None = None,
    *,
    planner: str | Planner = "symbolic",
    **options: Unpack[Options],
) -> Run:
    """Load, plan, execute, estimate and build the twin, all in memory.

    Args:
        scene: MJCF as for `load`, or a `Scene`; None lets a model look at a picture instead.
        request: what you want to simulate, in your words; None asks for everything missing.
        planner: as `Scene.plan`.
        options: as `load`: `poses`, `arm`, `cautious`, `robot_config`, `root`, `robot_body`; as
            `Scene.plan`: `measure`, `images`, `remeasure`, `within`, `model_settings`; as
            `Plan.run`: `seed`, `noise`, `world`, `robot`, `cell`, `on_failure`, `rehearse`, `fast`,
            `out`, `confirm`, `observer`, `progress`; as `see`: `camera`, `intrinsics`,
            `pose_estimator`, a look before the run. Its poses replace those of the scene, in
            `run.scene` and already for `confirm`.

    Returns:
        The finished run, in memory; with `out=` also in a folder.

    Raises:
        InputError: bad input.
        Unavailable: planner or robot out of reach.
        ExecutionAborted: a real robot was not allowed to move.
    """
    # Distribute the options over the verbs.
    of_load, of_run = _select_options(load, options), _select_options(Plan.run, options)
    loaded = load(scene, **of_load) if isinstance(scene, str | Path) else scene
    names = [field.name for field in fields(Settings)]
    stated: dict[str, Any] = {n: v for n, v in options.items() if n in names and v is not None}
    if loaded is not None:
        stated = {name: value for name, value in stated.items() if name not in of_load}
    if not is_file(stated.get("world")):
        stated.pop("world", None)  # MJCF text, or a scene: `Plan.run` reads it
    given = Settings() if loaded is None else loaded.given
    asked = given.having(request=request, planner=planner_name(planner), **stated)
    # Check everything before the plan: a model's answer costs money.
    asked = asked.check_values(at_hand=loaded is not None)
    if options.get("cell") is None:
        pipeline.preflight(asked)
    # Read the world once: the camera may look at the world in which the robot then moves.
    of_run["world"] = hidden_world(options.get("world"), asked)
    run = pipeline.prepare(
        asked,
        loaded,
        RunCallbacks(progress=options.get("progress", ignore)),
        None if isinstance(planner, str) else planner,
        of_run["world"],
    )
    return plan_of(run).run(**of_run)


def _select_options(verb: Callable[..., object], options: Mapping[str, Any]) -> dict[str, Any]:
    """Select the options that are arguments of a verb."""
    return {name: options[name] for name in signature(verb).parameters if name in options}
