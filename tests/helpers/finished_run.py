"""A hand-made run of the first scenario: 31 s of samples with two measured windows and a touch."""

from __future__ import annotations

import difflib

import numpy as np
import pytest

from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate, FurtherValue
from palpate.planning.plan import Node, Plan
from palpate.runs.report.data import ReportData
from palpate.runs.run import Ending, Run
from palpate.runs.settings import Settings
from palpate.scene.load import parse_scene
from palpate.trace.recording import Context, Conversion, LeafRun, NominalHand, Recording
from palpate.trace.samples import FORCES, POSE, Samples, Trace
from palpate.twin.twin import Twin
from palpate.twin.validate import ReplayResidual, Validation

MASS, HEIGHT = Parameter("bottle", "mass"), Parameter("table", "height")

STEPS = (
    ("MoveJoints", {"joints": "home_config"}, 2.0),
    ("OpenGripper", {}, 0.8),
    ("MovePose", {"pose": "bottle_pose + z_offset"}, 3.0),
    ("MovePose", {"pose": "bottle_pose"}, 2.0),
    ("CloseGripper", {}, 1.0),
    ("MovePose", {"pose": "bottle_pose + z_offset"}, 2.2),
    ("MeasureForces", {}, 1.5),
    ("Force2Mass", {}, 0.1),
    ("MovePose", {"pose": "bottle_pose"}, 2.4),
    ("OpenGripper", {}, 0.8),
    ("MovePose", {"pose": "table_approach"}, 3.5),
    ("CloseGripper", {}, 0.9),
    ("MoveUntilContact", {"axis": "-z"}, 6.2),
    ("MeasureGripperPose", {}, 0.3),
    ("Pose2Height", {}, 0.1),
    ("MoveJoints", {"joints": "home_config"}, 4.2),
)
HAND = NominalHand(
    tip_offset=0.009,
    force_repeatability=0.15,
    torque_gain=0.01,
    pose_repeatability=1e-4,
    joints=tuple(f"fr3_joint{i}" for i in range(1, 8)),
)


def leaf_runs() -> tuple[LeafRun, ...]:
    ends = np.cumsum([duration for _, _, duration in STEPS])
    return tuple(
        LeafRun(
            f"tree.children[{i}]",
            kind,
            f"{kind}({', '.join(args.values())})",
            float(end - duration),
            float(end),
            "SUCCESS",
            f"done in {duration} s",
            Context("still", at="bottle_pose"),
        )
        for i, ((kind, args, duration), end) in enumerate(zip(STEPS, ends, strict=True))
    )


def samples(duration: float, rate: float = 100.0) -> Samples:
    rng = np.random.default_rng(0)
    t = np.arange(0.0, duration, 1 / rate)
    n = len(t)
    wrench = rng.normal(0, 0.04, (n, 6))
    wrench[:, 2] += np.where((t > 10) & (t < 15), 0.254 * 9.81, 0.0) - np.where(
        (t > 26.2) & (t < 27), 6.0, 0.0
    )
    z = 0.86 + 0.1 * np.cos(t / 31 * 4 * np.pi) - np.clip((t - 20) / 6.4, 0, 1) * 0.1
    pose = np.column_stack(
        [0.5 + 0.02 * np.sin(t), 0.1 * np.cos(t / 9), z, np.zeros(n), np.ones(n), np.zeros((n, 2))]
    )
    return Samples(
        t=t,
        q=rng.normal(0, 1, (n, 7)),
        dq=rng.normal(0, 0.1, (n, 7)),
        tau_ext=rng.normal(0, 0.1, (n, 7)),
        wrench=wrench,
        pose_world_tcp=pose,
        twist=rng.normal(0, 0.01, (n, 6)),
        target_world_tcp=pose + 1e-4,
        width=np.where((t > 8) & (t < 15), 0.062, 0.08),
    )


def make_trace() -> Trace:
    leaves = leaf_runs()
    weigh = Recording(
        FORCES,
        leaves[6].start,
        leaves[6].end,
        Context("still", at="bottle_pose + z_offset", holding="bottle", grasp="bottle_pose"),
        leaves[6].node,
    )
    touch = Recording(
        POSE,
        leaves[13].start,
        leaves[13].end,
        Context("contact", at="table_approach", support="table"),
        leaves[13].node,
    )
    conversions = (
        Conversion("Force2Mass", "bottle", "mass", weigh, weigh.end + 0.1),
        Conversion("Pose2Height", "table", "height", touch, touch.end + 0.1),
    )
    return Trace(samples(31.0), leaves, (weigh, touch), conversions, HAND)


def make_plan() -> Plan:
    children = tuple(Node(kind, tuple(args.items())) for kind, args, _ in STEPS)
    return Plan(
        (MASS, HEIGHT),
        Node("Sequence", (), children),
        "The bottle's mass is weighed by lifting it clear of the table; the table's height is felt beside it.",
        "symbolic",
        ("the friction of the table is known already",),
    )


def make_estimates(trace: Trace) -> tuple[Estimate, ...]:
    weigh, touch = trace.recordings
    mass = Estimate(
        MASS,
        "kg",
        (0.2541,),
        (0.0008,),
        ((0.2525, 0.2557),),
        "Mean vertical force while held still, less the empty hand's at the same pose, over g.",
        (weigh,),
        parts={"single-shot": FurtherValue(0.262, 0.02)},
    )
    height = Estimate(
        HEIGHT,
        "m",
        (0.76503,),
        (0.00006,),
        ((0.76491, 0.76515),),
        "Fingertip height at the onset of contact, corrected for penetration and compliance.",
        (touch,),
    )
    return mass, height


SCENE = """<mujoco>
  <worldbody>
    <!-- height? -->
    <body name="table" pos="0.58 0 ?">
      <geom type="box" size=".35 .45 .018"/>
    </body>
    <body name="bottle" pos="0.50 0.10 0.868">
      <freejoint/>
      <geom type="cylinder" size=".031 .100" material="glass"/>
    </body>
  </worldbody>
</mujoco>
"""
TWIN = SCENE.replace("0.58 0 ?", "0.58 0 0.74703").replace(
    'material="glass"', 'material="glass" mass="0.2541"'
)


def make_run() -> Run:
    trace = make_trace()
    diff = difflib.unified_diff(
        SCENE.splitlines(True), TWIN.splitlines(True), "scene.xml", "twin.xml"
    )
    request = "We want to build a simulation, but we don't know the mass of the bottle and the height of the table."
    residual = ReplayResidual(0.02, None)
    return Run(
        Settings(request=request, seed=7, noise="lab"),
        parse_scene(SCENE.replace('material="glass"', "")),
        make_plan(),
        world="simulated world world.xml",
        execution=Ending("complete", None, 16, 31.0, 4.0),
        recorded=trace,
        estimates=make_estimates(trace),
        truth={MASS: (0.254,), HEIGHT: (0.765,)},
        finished=Twin(TWIN, "".join(diff), (), Validation(True, 0.0, residual, residual)),
        total_seconds=4.2,
    )


def make_data() -> ReportData:
    files = ("request.json", "plan.json", "tree.xml", "trace.mcap", "result.json", "twin.xml")
    return ReportData(make_run(), files=(*files, "images/before.png"))


@pytest.fixture(scope="session")
def trace() -> Trace:
    return make_trace()


@pytest.fixture(scope="session")
def data() -> ReportData:
    return make_data()
