"""Functions of the command line without a run.

They check a plan, compose a prompt for a model, teach poses, list the vocabulary of plans, and
write a motion to record.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from palpate.common.errors import InputError, Unavailable
from palpate.common.files import read_text, write_new, writing, yaml_text
from palpate.execution.cell import GuidedHand, Lesson
from palpate.execution.cell_drivers import drivers
from palpate.perception.renderer import gl_available as gl_available
from palpate.planning.btcpp import tree_nodes_model as tree_nodes_model
from palpate.planning.check.check import check
from palpate.planning.check.finding import Finding
from palpate.planning.model.prompt import Prompt, compose
from palpate.planning.model.provider import PROVIDERS
from palpate.planning.plan import Node
from palpate.planning.planner import in_words, named_parameters
from palpate.planning.registry import complete_parameters, load_proposal, planners
from palpate.planning.registry import plan_file as plan_file
from palpate.primitives.registry import COMPOSITES
from palpate.primitives.registry import plan_schema as plan_schema
from palpate.primitives.registry import vocabulary as vocabulary
from palpate.primitives.rules.collision_geometry import require_room
from palpate.robots.owner import load_description, own_arm
from palpate.runs import pipeline
from palpate.runs.settings import Settings
from palpate.scene.picture_scene import DetectedScene, SceneBuilder
from palpate.scene.poses import MAX_BYTES as MAX_POSES
from palpate.scene.poses import Poses, parse_poses, read_poses
from palpate.scene.scaffold import POSES, SCENE, Scaffold, write_texts
from palpate.scene.scaffold import new_scene as new_scene


def examine_real_robot(
    asked: Settings, may_hold: Callable[[], bool]
) -> Iterator[tuple[bool, str, str]]:
    """Examine the real robot that the settings name; yield (passed, subject, finding or remedy).

    `may_hold` asks for permission to let the arm hold itself for some seconds.

    Raises:
        InputError: no such URL or arm.
        Unavailable: no driver, or one without an examination.
    """
    url = asked.robot or ""
    driver = drivers().of(url)
    if driver.examine is None:
        raise Unavailable(f"the driver for '{url}' cannot examine its robot")
    return driver.examine(url, own_arm(asked.arm, False, asked.robot_config, real=True), may_hold)


def examine_planner(
    planner: str, base_url: str | None, seconds: float
) -> Iterator[tuple[bool, str, str]]:
    """Examine a planner, with results as of `examine_real_robot`.

    A model's server is asked for its models, the model for a word and for the colour of a picture.
    Each may take `seconds`.
    """
    if planner.partition(":")[0] in PROVIDERS:
        from palpate.planning.model.examine import examine

        return examine(planner, base_url, seconds)
    planners().make(planner)
    return iter([(True, planner, "needs no server")])


def lesson(asked: Settings) -> Lesson:
    """Prepare the teaching of the poses of the settings' scene, with the known ones."""
    # Begin with the known poses; their other entries are kept unchanged.
    poses, loaded = asked.poses, asked.read_scene(load_description(asked.arm))
    poses_stated = read_poses(poses).model_dump(exclude_defaults=True, mode="json") if poses else {}
    objects, places = poses_stated.pop("objects", {}), poses_stated.pop("places", {})
    return Lesson(loaded, objects, places, poses_stated)


def guided_hand(url: str, taught: Lesson) -> GuidedHand:
    """Connect to the hand of the real robot at a URL, for guiding by a person.

    Raises:
        InputError: no such URL.
        Unavailable: no driver, no answer, or a robot that cannot be guided.
    """
    driver = drivers().of(url)
    if driver.guided is None:
        raise Unavailable(f"the robot at '{url}' cannot be led by hand")
    return driver.guided(url, taught.scene)


def write_poses(path: Path, taught: Lesson) -> None:
    """Write the taught poses to a new poses.yaml."""
    text = yaml_text(taught.content)
    parse_poses(text, str(path))
    write_new(path, text)


def tag_sheet(path: Path, numbers: str, side: float) -> int:
    """Write a PDF of tags, `0-11` or `3,7,9`, to print with a `side` in m; return its page count.
    Raises InputError: no such tags, an impossible side, or the file exists or cannot be written."""
    from palpate.perception.tags import write_sheet

    # Parse single numbers and ranges.
    chosen: list[int] = []
    for part in numbers.split(","):
        first, _, last = part.strip().partition("-")
        if not first.isdecimal() or not (last or first).isdecimal() or len(part) > 8:
            raise InputError(f"numbers= takes tags such as 0-11 or 3,7,9, not '{numbers[:40]}'")
        chosen += range(int(first), int(last or first) + 1)
    return write_sheet(path, chosen, side)


def write_excitation(arm: str, path: Path) -> list[str]:
    """Write a motion of an arm that excites a load into a new file; return the instructions for its
    recording. Raises InputError: no such arm, or the file exists or cannot be written."""
    from palpate.estimation.logs.excitation import excitation

    if path.exists():
        raise InputError(f"'{path}' exists already: choose another out=")
    trajectory = excitation(load_description(arm))
    with writing(path):
        path.write_text(trajectory.csv(), encoding="utf-8")
    return trajectory.told(arm, str(path)).splitlines()


def check_file(plan: Path, asked: Settings) -> tuple[Finding, ...]:
    """Check a plan in a file, a chat's answer or a run folder; return the findings.

    Without a scene it is checked against the objects in its file, or without any.
    """
    # Check against the scene, or against the objects in the plan's own file.
    proposal = load_proposal(plan)
    arm, known = load_description(asked.arm), None
    if asked.scene is not None:
        known = asked.read_scene(arm)
        require_room(known)
    elif asked.poses is not None and proposal.scene:
        builder = SceneBuilder(read_poses(asked.poses), arm)
        known = DetectedScene(builder, proposal.scene).scene()
    return check(complete_parameters(proposal, known), known)


def prompt(settings: Settings) -> Prompt:
    """Compose the system prompt, user message and images for a model. Raises InputError: a value
    out of range, or a file that cannot be read."""
    # A scene gives its own names; without one the workplace does.
    settings = settings.check_values()
    scene = pipeline.load(settings)
    # Without a scene, the prompt has the names of the workplace only.
    symbols = arm = None
    if scene is None:
        poses, arm = (
            read_poses(settings.poses) if settings.poses else Poses(),
            settings.described_arm(),
        )
        symbols = SceneBuilder(poses, arm).symbols
    request = settings.request or ""
    if settings.measure:
        if scene is None:
            raise InputError("measure= names parameters of a scene: give scene=D.xml")
        request = f"{request} {in_words(named_parameters(settings.measure, scene))}".lstrip()
    model_settings = settings.model_settings
    return compose(
        vocabulary(),
        request,
        scene,
        settings.images,
        symbols,
        model_settings.without,
        model_settings.prompt,
        model_settings.comments,
        arm,
        settings.remeasure,
    )


def paper_notation(node: Node, depth: int = 0) -> Iterator[str]:
    """Format a tree in the paper's notation, one line a node: {-} Sequence, /_/ Parallel, → action."""
    indent = "    " * depth
    if node.type in COMPOSITES:
        yield f"{indent}{COMPOSITES[node.type].symbol} {node.type}"
    else:
        arguments = ", ".join(str(value) for _, value in node.args)
        yield f"{indent}→ {node.type}({arguments})"
    for child in node.children:
        yield from paper_notation(child, depth + 1)


def scene_from_picture(settings: Settings, folder: Path) -> Scaffold:
    """Write the scene that a model detects in a picture, with its poses. The model's plan is not used.

    Raises:
        InputError: no picture, no camera, a planner that is not a model, nothing detected, or a
            folder that cannot be written.
        Unavailable: the model's server.
    """
    if not settings.images or settings.poses is None:
        raise InputError(
            "a scene from a picture needs the picture (--image photo.jpg) and, in a poses.yaml "
            "(--poses), the camera that took it: pos, quat, fovy and size"
        )
    # Use only the scene of the model's answer.
    run = pipeline.plan(settings.check_values(), None)
    texts = {
        SCENE: run.scene.resolved.document.text,
        POSES: read_text(settings.poses, MAX_POSES, "poses"),
    }
    write_texts(folder, texts)
    names = tuple(run.scene.objects)
    return Scaffold(folder / SCENE, folder / POSES, names)
