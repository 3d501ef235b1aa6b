"""Estimates and a twin from a recording that another program made. Nothing is planned, and nothing
moves.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.common.errors import InputError, unknown_name
from palpate.common.parameter import Parameter
from palpate.common.pose import Pose
from palpate.estimation.carried import HAND
from palpate.estimation.logs.reading import read_recording, require_joint_torques
from palpate.estimation.logs.trace import Carrying, trace_of, trace_of_wrench
from palpate.estimation.logs.wrench_log import WrenchLog
from palpate.estimation.quantities.estimators import estimate_all
from palpate.estimation.recording_check import require_within_limits
from palpate.planning.plan import Plan
from palpate.planning.symbolic.planner import split_known, stated_clause
from palpate.robots.description import RobotDescription
from palpate.robots.owner import own_arm
from palpate.runs.building import build_twin
from palpate.runs.callbacks import SILENT, RunCallbacks
from palpate.runs.read import EMPTY_SCENE
from palpate.runs.run import RECORDING, Ending, Run
from palpate.runs.settings import Settings
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene
from palpate.trace.recording import ArmLog
from palpate.trace.samples import Trace

FARTHEST = 2.0  # m: largest distance from the hand to the frame of the object in it
LOAD = "load"  # Name of a load that is not an object of a scene


def estimate_recording(
    settings: Settings,
    file: Path,
    carrying: Carrying,
    empty: Path | None = None,
    columns: Path | None = None,
    callbacks: RunCallbacks = SILENT,
) -> Run:
    """Estimate the load of a recording. If a scene has the load as an object, build the twin.

    Only scene, poses, root, arm, robot.yaml and `remeasure` of the settings are used. `empty` is a recording of
    the empty hand, and `columns` maps the columns of both.

    Raises:
        InputError: a file that cannot be used, an unknown object, or a window that the recording
            does not have.
        Unavailable: the library for the recording's format is not installed.
    """
    began = time.perf_counter()
    # Load the arm and the scene that contains the load.
    arm = own_arm(settings.arm, settings.cautious, settings.robot_config, real=True)
    if settings.scene is None:
        scene = parse_scene(EMPTY_SCENE, arm=arm)
    else:
        scene = settings.read_scene(arm)
        objects = [name for name, body in scene.bodies.items() if body.role == "object"]
        if carrying.name not in objects:
            raise unknown_name(
                "object", carrying.name, objects, "The load is one of them: object=NAME."
            )
    # Read the recordings, and require that they are possible for the arm.
    callbacks.progress("reading the recording")
    logs = [read_recording(item, columns, arm) for item in (file, empty) if item]
    for log in logs:
        if isinstance(log, ArmLog):
            require_joint_torques(arm)
            require_within_limits(log, arm)
    # Centre of mass and inertia need the object's pose in the hand, or no scene.
    quantities = ["mass"]
    notes = [f"{log.source}: {note}." for log in logs for note in log.notes]
    if settings.scene is None or carrying.in_hand is not None:
        quantities += ["com", "inertia"]
    else:
        notes.append("Centre of mass and inertia need the object's pose in the hand: in_hand=POSE.")
    # Convert the recordings to a trace, and estimate.
    parameters = [Parameter(carrying.name, quantity) for quantity in quantities]
    if carrying.hand == "found":
        parameters.append(Parameter(HAND, "mass"))
    twin = "gets the measured value" if settings.remeasure else "keeps it, without --remeasure"
    stated, _ = split_known(parameters, scene, remeasure=False)
    notes += [f"{stated_clause(item, scene)}; the twin {twin}." for item in stated]
    trace = _trace(logs, carrying, parameters, arm, scene)
    callbacks.progress("estimating")
    bodies = scene.bodies
    # Request only the masses: the other quantities are by-products, if the motion excites them.
    asked = tuple(item for item in parameters if item.quantity == "mass")
    reading = _explain_reading(f"{file.name}, {len(logs[0])} samples", carrying, empty)
    plan = Plan(asked, None, reading, RECORDING, tuple(notes))
    # Make a run as if the plan had been executed: estimates, twin and report are the same.
    run = Run(
        replace(settings, robot=f"recording:{file.name}", noise="none"),
        scene,
        plan,
        world=f"the recording {file.name}",
        simulated=False,
        execution=Ending("complete", None, 0, float(logs[0].t[-1]), 0.0),
        recorded=trace,
        estimates=estimate_all(parameters, trace, bodies),
        begun=began,
    )
    if settings.scene is not None:
        run = build_twin(run, callbacks)
    return replace(run, total_seconds=time.perf_counter() - began)


def _trace(
    logs: Sequence[ArmLog | WrenchLog],
    carrying: Carrying,
    parameters: Sequence[Parameter],
    arm: RobotDescription,
    scene: Scene,
) -> Trace:
    """Convert a recording, and that of the empty hand if there is one, to a trace.

    Raises:
        InputError: One has joint torques and the other a wrench, a window is not in the recording, or the hand of a
            sensor cannot be weighed.
    """
    base, gravity = scene.pose_world_base, scene.gravity
    arms = [log for log in logs if isinstance(log, ArmLog)]
    sensors = [log for log in logs if isinstance(log, WrenchLog)]
    if arms and sensors:
        raise InputError(
            f"{arms[0].source} has joint torques and {sensors[0].source} a wrench: give two recordings of one kind, or "
            "state the wrench of both with 'wrench: NAME' in columns=MAP.yaml"
        )
    if arms:
        empty_arm = arms[1] if len(arms) > 1 else None
        return trace_of(arms[0], carrying, parameters, arm, base, gravity, empty_arm)
    empty = sensors[1] if len(sensors) > 1 else None
    if carrying.hand is not None and not (carrying.windows or empty):
        raise InputError(
            "hand=: a sensor sees all that is mounted below it as one load; give the windows of the load (loaded=…) or "
            "a recording without it (empty=LOG)"
        )
    return trace_of_wrench(sensors[0], carrying, parameters, base, gravity, empty)


def _explain_reading(of: str, carrying: Carrying, empty: Path | None) -> str:
    """Explain the reading: file, windows and hand."""
    windows = ", ".join(f"{start:g} to {end:g} s" for start, end in carrying.windows)
    text = f"{of}; {carrying.name} was carried "
    text += f"from {windows}" if windows else "all the time"
    if empty is not None:
        text += f"; the empty hand is in {empty.name}, too"
    hand = "weighed, too" if carrying.hand == "found" else f"of {carrying.hand} kg"
    return f"{text}. The hand is {'as described' if carrying.hand is None else hand}."


def pose_text(pose: str) -> str:
    """Check a pose in the hand, `X Y Z [QW QX QY QZ]` with blanks or commas, and return its seven
    numbers as text. Raises InputError: not such numbers."""
    try:
        numbers = [float(word) for word in pose.replace(",", " ").split()]
    except ValueError:
        numbers = []
    turn = numbers[3:] or [1.0, 0.0, 0.0, 0.0]
    # Three numbers are a position without rotation; a quaternion must not be zero.
    is_pose = len(numbers) in (3, 7) and np.isfinite(numbers).all() and any(turn)
    if not is_pose or max(map(abs, numbers[:3])) > FARTHEST:
        raise InputError(
            f"in_hand='{pose[:60]}': give X Y Z in m, at most {FARTHEST:g}, or X Y Z QW QX QY QZ"
        )
    return " ".join(f"{number:g}" for number in Pose.of(numbers[:3], turn).vector)
