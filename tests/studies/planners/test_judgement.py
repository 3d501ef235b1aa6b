import re

import pytest

from palpate.common.parameter import Parameter
from palpate.studies.judgement import objection
from palpate.trace.recording import Context, Conversion, LeafRun, NominalHand, Recording
from palpate.trace.samples import FORCES, POSE, Samples, Trace

HAND = NominalHand(0.009, 0.15, 0.01, 0.0001)
MASS, FRICTION, COM = (
    Parameter("cup", "mass"),
    Parameter("cup", "friction"),
    Parameter("cup", "com"),
)


def recording(
    start: float,
    activity: str = "still",
    holding: str | None = "cup",
    grasp: str = "cup_pose",
    buffer: str = FORCES,
    at: str | None = None,
) -> Recording:
    return Recording(
        buffer,
        start,
        start + 1,
        Context(activity, at=at, holding=holding, grasp=grasp),
        f"node {start:g}",
    )  # type: ignore[arg-type]


def leaf(status: str = "SUCCESS", holding: str | None = "cup") -> LeafRun:
    return LeafRun(
        "tree.children[0]",
        "MovePose",
        "MovePose(cup_pose)",
        0.0,
        1.0,
        status,
        "too far",  # type: ignore[arg-type]
        Context("still", holding=holding),
    )


def weighed(at: Recording, name: str = "cup") -> Conversion:
    return Conversion("Force2Mass", name, "mass", at, at.end)


def trace(
    recordings: list[Recording], conversions: list[Conversion], leaves: list[LeafRun] | None = None
) -> Trace:
    return Trace(
        Samples.empty(), tuple(leaves or [leaf()]), tuple(recordings), tuple(conversions), HAND
    )


ONE = recording(0.0)


def test_the_right_measurement_of_the_right_object_is_a_success() -> None:
    assert objection(trace([ONE], [weighed(ONE)]), [MASS]) == ""


@pytest.mark.parametrize(
    ("kept", "reason"),
    [
        (trace([], []), "not acquired: cup.mass"),
        (trace([ONE], [weighed(ONE)], [leaf("FAILURE")]), r"MovePose\(cup_pose\) failed: too far"),
        (trace([ONE], [weighed(ONE)], [leaf("INVALID")]), "failed"),
        (trace([ONE], [weighed(ONE), weighed(ONE, "jug")]), "not asked for: jug.mass"),
        (trace([ONE], [weighed(ONE), weighed(ONE)]), "more than once: cup.mass"),
        (trace([ONE, recording(2.0)], [weighed(ONE)]), "without need at node 2"),
        (trace([ONE, recording(2.0, buffer=POSE)], [weighed(ONE)]), "without need at node 2"),
        (trace([ONE], [weighed(ONE)], [leaf(), leaf(holding="jug")]), "touched needlessly: jug"),
    ],
)
def test_anything_missing_redundant_or_failed_is_an_objection(kept: Trace, reason: str) -> None:
    assert re.search(reason, objection(kept, [MASS]))


def test_a_blocking_object_may_be_touched_if_the_task_says_so() -> None:
    kept = trace([ONE], [weighed(ONE)], [leaf(), leaf(holding="jug")])
    assert objection(kept, [MASS], may_touch=["jug"]) == ""


def test_friction_takes_a_log_while_sliding() -> None:
    slid = recording(2.0, "sliding", at="cup_pose + x_offset")
    assert objection(trace([ONE, slid], [weighed(ONE)]), [MASS, FRICTION]) == ""
    assert "cup.friction" in objection(trace([ONE], [weighed(ONE)]), [MASS, FRICTION])


def test_a_centre_of_mass_takes_three_grasps() -> None:
    logs = [recording(float(i), grasp=f"cup_pose + {i}*x_offset") for i in range(3)]
    assert objection(trace(logs, []), [COM]) == ""
    assert "cup.com" in objection(trace([logs[0], logs[0]], []), [COM])


def test_nothing_expected_and_nothing_done_is_a_success() -> None:
    assert objection(trace([], [], [leaf(holding=None)]), []) == ""
