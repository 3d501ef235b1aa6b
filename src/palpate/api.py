"""The front door: a scene, a plan and a run, each with the verbs that lead to the next.

    scene = pp.load("desk.xml")
    plan = scene.plan("how heavy is the mug?")
    run = plan.run(seed=0)

`Scene`, `Plan` and `Run` are the inner classes plus verbs that call the pipeline, so that inner rooms
never import upwards and there is no second scene.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from palpate import pipeline
from palpate.audience import SILENT, Audience, Confirm, Progress, quiet, unasked
from palpate.cells.cell import Cell
from palpate.display import table
from palpate.estimation.estimate import Estimate
from palpate.execution.recovery import OnFailure
from palpate.planning.check.check import Finding
from palpate.planning.model.settings import ModelSettings
from palpate.planning.plan import Plan as InnerPlan
from palpate.planning.planner import Planner
from palpate.quantities.precision.within import Within
from palpate.robots.owner.registered import own_arm
from palpate.robots.registry import DEFAULT
from palpate.runs.fuse import Fusion as InnerFusion
from palpate.runs.fuse import fuse_runs, write_fusion
from palpate.runs.run import Run as InnerRun
from palpate.scene.load import load_scene, parse_scene
from palpate.scene.poses import read_poses
from palpate.scene.remarks import remarks
from palpate.scene.scene import Scene as InnerScene
from palpate.scene.scene import with_real_arm
from palpate.settings import Settings
from palpate.stages.estimating import reestimate

if TYPE_CHECKING:
    from palpate.execution.runner import Observer
    from palpate.twin.export.export import Export

__all__ = ["Fusion", "Plan", "Run", "Scene", "fuse", "load", "open", "run"]

Widths = Mapping[str, str | float]
"""Half widths of intervals, by quantity or by parameter: `{"mass": "1g"}`, or SI numbers."""


@dataclass(frozen=True, eq=False, repr=False)
class Scene(InnerScene):
    """An incomplete simulation description, as `load` reads it.

    Attributes:
        poses_file: the `poses.yaml` that came with it. arm_name, cautious, robot_config, root,
            robot_body: as `load` was told.

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
            InputError: a request or a planner that cannot be used. Unavailable: a provider out of
                reach.
        """
        asked = Settings(
            request=request,
            images=_paths(images),
            planner=_name(planner),
            remeasure=remeasure,
            within=Within.read(within or {}),
            model_settings=model_settings or ModelSettings(),
        )
        return _plan_of(self.settings(asked), self, planner)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What was taken for what, what was left out, and why nothing may be missing."""
        return remarks(self)

    def settings(self, asked: Settings) -> Settings:
        """What is asked, of this scene.

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


@dataclass(frozen=True, repr=False)
class Plan(InnerPlan):
    """A checked plan, and the run that it begins."""

    made: InnerRun = field(kw_only=True, compare=False)
    """The run so far: what was asked, the scene, this plan and what is wrong with it."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What speaks against the plan; a plan with findings is not executed."""
        return self.made.findings

    def run(
        self,
        cell: Cell | None = None,
        *,
        world: str | Path | InnerScene | None = None,
        robot: str | None = None,
        noise: str = "lab",
        seed: int = 0,
        on_failure: OnFailure = "stop",
        rehearse: bool | None = None,
        within: Widths | None = None,
        fast: bool = False,
        confirm: Confirm = unasked,
        observer: Observer | None = None,
        progress: Progress = quiet,
        out: str | Path | None = None,
    ) -> Run:
        """Execute the plan, estimate, and build the twin.

        Args:
            cell: the workplace; None makes the one that the next arguments describe.
            world: MJCF of the hidden simulated world (a file, its text, or a scene); None simulates
                the plan's scene with its unknowns drawn from priors.
            robot: URL of a real robot.
            noise: how the simulated robot differs from its model, a name or a FILE.yaml. seed: of
                everything random in it.
            on_failure: `stop`, `skip` or `replan`: what to do when an action fails.
            rehearse: execute in simulation first; None means before a real robot moves.
            within: half widths of 95 % intervals to reach; None keeps those that were planned for.
            fast: leave out film and replay in the twin, which take longest and measure nothing.
            confirm: shown the run before a real robot moves; whether it may.
            observer: watches every tick. progress: told which stage begins, e.g. `print`.
            out: folder to write the run to, while it grows; must not exist.

        Returns:
            The finished run. Where the plan has no tree, or findings, nothing moves and its status
            is `rejected`. What failed once something had moved, and where a Ctrl-C ended it, it
            says itself (`shortfalls`, `interrupted`).

        Raises:
            InputError: bad input. Unavailable: no such robot. ExecutionAborted: not confirmed, or
                interrupted before anything moved.
        """
        if rehearse is None and cell is not None:
            rehearse = not cell.simulated
        if _is_text(world):
            settings = self.made.settings
            world = load(str(world), arm=settings.arm, cautious=settings.cautious)
        if isinstance(world, InnerScene):
            from palpate.cells.simulated import simulated_cell

            cell = simulated_cell(self.made.scene, world, noise=noise, seed=seed)
            world = world.path
        settings = replace(
            self.made.settings,
            world=_path(world),
            robot=robot,
            noise=noise,
            seed=seed,
            on_failure=on_failure,
            rehearse=rehearse,
            fast=fast,
            out=_path(out),
        ).checked(at_hand=True)
        if within is not None:
            settings = replace(settings, within=Within.read(within))
        made = replace(self.made, settings=settings)
        if robot is not None:
            made = replace(made, scene=with_real_arm(made.scene))
        audience = Audience(observer, progress, confirm)
        return _run_of(pipeline.carry_out(made, audience, cell, settings.out))

    def _repr_html_(self) -> str:
        rows = [(line,) for line in str(self).splitlines()[1:]]
        return table(repr(self), ("tree",), rows)


@dataclass(frozen=True, eq=False, repr=False)
class Run(InnerRun):
    """What a run made: `run["mug.mass"]`, `run.trace`, `run.twin`. See `palpate.runs.run.Run`."""

    def save(self, folder: str | Path) -> Run:
        """Write the run folder: request, plan, tree, trace, result, twin, report and images.

        Returns:
            This run, which now knows its folder.

        Raises:
            InputError: the folder exists or cannot be made.
        """
        return _run_of(pipeline.save(self, Path(folder)))

    def estimate(self, estimators: Mapping[str, str] | None = None) -> Run:
        """This run with its estimates made anew from its trace: nothing moves, its folder stays as
        it is, and there is no twin of them.

        Args:
            estimators: names by quantity, `{"mass": "single-shot"}`; else the defaults.

        Raises:
            InputError: it has no trace, another version recorded it, or there is no such estimator.
        """
        return _run_of(reestimate(self, estimators))

    def export(self, to: str, folder: str | Path | None = None) -> Export:
        """Write the twin for another simulator into a new folder, and read it back.

        Args:
            to: `mjcf` (with every file that it needs), `urdf` or `usd`.
            folder: by default `export-FORMAT` in the run's own.

        Raises:
            InputError: it has no twin, there is no such format, or the folder exists or cannot be
                made. Unavailable: what writes the format is not installed. PalpateError: what was
                written does not say what the twin says.
        """
        from palpate.runs.export import export_run

        return export_run(self, to, _path(folder))

    def _repr_html_(self) -> str:
        rows: list[tuple[str, ...]] = []
        for estimate in self.estimates:
            rows.append((repr(estimate).strip("<>"),))
        return table(repr(self), ("estimates",), rows)


@dataclass(frozen=True, eq=False, repr=False)
class Fusion(InnerFusion):
    """What several runs say together: `fusion["mug.mass"]`, `fusion.twin`. See
    `palpate.runs.fuse.Fusion`."""

    def save(self, folder: str | Path) -> Fusion:
        """Write result and twin into a new folder.

        Raises:
            InputError: the folder exists or cannot be made.
        """
        write_fusion(self, Path(folder))
        return replace(self, folder=Path(folder))

    def _repr_html_(self) -> str:
        rows = [(repr(estimate).strip("<>"),) for estimate in self.estimates]
        return table(f"<Fusion of {len(self.runs)} runs>", ("estimates",), rows)


class RunOptions(TypedDict, total=False):
    """The arguments of `Plan.run`, for those who pass them on."""

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


def run(
    scene: str | Path | Scene | None = None,
    request: str | None = None,
    *,
    poses: str | Path | None = None,
    arm: str | Path = DEFAULT,
    cautious: bool = False,
    robot_config: str | Path | None = None,
    root: str | Path | None = None,
    robot_body: str | Sequence[str] = (),
    planner: str | Planner = "symbolic",
    images: Sequence[str | Path] = (),
    remeasure: bool = False,
    within: Widths | None = None,
    model_settings: ModelSettings | None = None,
    **options: Unpack[RunOptions],
) -> Run:
    """Load, plan, execute, estimate and build the twin, all in memory.

    Args:
        scene: MJCF as `load` takes it, or a scene; None lets a model look at a picture instead.
        request: what you want to simulate, in your words; None asks for all that is missing.
        poses: as `load`. arm: as `load`. cautious: as `load`. robot_config: as `load`.
        root: as `load`. robot_body: as `load`.
        planner: as `Scene.plan`. images: as `Scene.plan`. remeasure: as `Scene.plan`.
        within: as `Scene.plan`.
        model_settings: as `Scene.plan`.
        options: as `Plan.run`: `seed`, `noise`, `world`, `robot`, `cell`, `out`, `progress`, …

    Returns:
        The finished run, in memory; with `out=` also in a folder.

    Raises:
        InputError: bad input. Unavailable: planner or robot out of reach. ExecutionAborted: a real
            robot was not allowed to move.
    """
    asked = Settings(
        request=request,
        poses=_path(poses),
        images=_paths(images),
        planner=_name(planner),
        arm=str(arm),
        cautious=cautious,
        robot_config=_path(robot_config),
        root=_path(root),
        robot_body=_names(robot_body),
        remeasure=remeasure,
        within=Within.read(within or {}),
        model_settings=model_settings or ModelSettings(),
    )
    # How it is to run is looked at before anybody plans: a model's answer costs money.
    planned = replace(asked, **_stated(options)).checked(at_hand=scene is not None)
    if options.get("cell") is None:
        pipeline.preflight(planned)
    found = scene
    if isinstance(found, str | Path):
        found = load(found, poses, arm, cautious, robot_config, root, robot_body)
    if found is not None:
        planned = found.settings(planned)
    options.get("progress", quiet)("planning")
    return _plan_of(planned, found, planner).run(**options)


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
            repository, or else the home, that the scene is in, or else its own folder.
        robot_body: the body that the scene's own robot begins with, or several, or `none`; by
            default what actuators drive, or ends in a hand. The arm takes its place.

    Raises:
        InputError: malformed XML, missing files, names that do not match.
    """
    file, config = _path(poses), _path(robot_config)
    description = own_arm(str(arm), cautious, config)
    robots = _names(robot_body)
    if _is_text(source):
        entries = read_poses(file) if file is not None else None
        found = parse_scene(str(source), poses=entries, arm=description, robot_body=robots)
    else:
        path = Path(source)
        found = load_scene(path, file, description, root=_path(root), robot_body=robots)
    return Scene(
        **_contents(found),
        poses_file=file,
        arm_name=str(arm),
        cautious=cautious,
        robot_config=config,
        root=_path(root),
        robot_body=robots,
    )


def open(folder: str | Path) -> Run:
    """The run in a folder that `Run.save` or the command line wrote.

    Its trace is read when first asked for. A folder does not keep the camera's
    footage; where the scene's file has gone since, the scene is empty.

    Raises:
        InputError: there is no such folder, or it is not a run's.
    """
    return _run_of(pipeline.reopen(Path(folder)))


def fuse(runs: Sequence[str | Path | InnerRun]) -> Fusion:
    """What several runs of one scene say together.

    Each parameter gets the mean of least variance of the estimates that are identified; what runs of
    one arm, or of one scene, have in common (gains, fingertips, poses) is not averaged away. Runs
    that disagree make it *contradicted*.

    Args:
        runs: folders, or runs at hand.

    Raises:
        InputError: fewer than two runs, runs that are not of one scene, or the same recordings twice.
    """
    opened = [one if isinstance(one, InnerRun) else open(one) for one in runs]
    return Fusion(**_contents(fuse_runs(opened)))


def plan_settings(settings: Settings) -> Plan:
    """The plan that settings describe, as the command line has them.

    Raises:
        InputError: bad input. Unavailable: the provider.
    """
    settings = settings.checked()
    return _plan_of(settings, pipeline.load(settings), settings.planner)


def run_settings(settings: Settings, audience: Audience = SILENT) -> Run:
    """The run that settings describe, as the command line has them, into a run folder.

    Raises:
        InputError: bad input; nothing is planned then.
        Unavailable: planner or robot out of reach.
        ExecutionAborted: a real robot was not allowed to move.
    """
    return _run_of(pipeline.run(settings, audience))


def finish(folder: str | Path, progress: Progress = quiet) -> Run:
    """Do what a run that was cut off has left to do, with what its folder holds, and write its
    report anew.

    Raises:
        InputError: there is no such folder, or it is not a run's.
    """
    return _run_of(pipeline.finish(Path(folder), Audience(progress=progress)))


def _stated(options: RunOptions) -> dict[str, Any]:
    """Those of the options that settings hold; a world at hand has no file."""
    names = ("robot", "noise", "seed", "on_failure", "rehearse", "fast")
    stated: dict[str, Any] = {name: options.get(name) for name in names if name in options}
    folder, world = options.get("out"), options.get("world")
    if folder is not None:
        stated["out"] = Path(folder)
    if isinstance(world, str | Path) and not _is_text(world):
        stated["world"] = Path(world)
    return stated


def _plan_of(asked: Settings, scene: InnerScene | None, planner: str | Planner) -> Plan:
    made = pipeline.plan(asked, scene, None if isinstance(planner, str) else planner)
    return Plan(**_contents(made.plan), made=made)


def _run_of(made: InnerRun) -> Run:
    """The run with its verbs; its estimates say when they come from a simulation."""
    contents = _contents(made)
    if made.simulated:
        contents["estimates"] = tuple(_Simulated(**_contents(e)) for e in made.estimates)
    return Run(**contents)


class _Simulated(Estimate):
    """An estimate of a simulated run, which says so."""

    __slots__ = ()

    def __repr__(self) -> str:
        return f"{Estimate.__repr__(self)[:-1]}, simulated>"


def _contents(thing: Any) -> dict[str, Any]:
    """What a dataclass was made of, to make one of a subclass."""
    return {part.name: getattr(thing, part.name) for part in fields(thing) if part.init}


def _is_text(source: object) -> bool:
    """Whether it is MJCF itself and not the name of a file."""
    return isinstance(source, str) and source.lstrip().startswith("<")


def _names(given: str | Sequence[str]) -> tuple[str, ...]:
    """One name, or several."""
    return (given,) if isinstance(given, str) else tuple(given)


def _path(file: str | Path | None) -> Path | None:
    return Path(file) if file is not None else None


def _paths(files: Sequence[str | Path]) -> tuple[Path, ...]:
    return tuple(Path(file) for file in files)


def _name(planner: str | Planner) -> str:
    return planner if isinstance(planner, str) else planner.name
