"""Height and tilt: rigid tables, cloths on them, cushions, slopes, and things under one finger."""

from dataclasses import replace

import numpy as np
import pytest
from recordings import HAND

from palpate.common.parameter import Parameter
from palpate.common.pose import Pose
from palpate.estimation.quantities.height import estimate_height, estimate_tilt
from palpate.planning.symbolic.planner import SymbolicPlanner
from palpate.scene.load import parse_scene
from palpate.trace.recording import Context as Where
from palpate.trace.recording import Recording

HEIGHT = Parameter("table", "height")
TABLE = 0.2653
CLOTH = 0.015


def rigid(z):
    return max(0.0, TABLE - z) * 4e4


def cloth(z):
    pressed = min(max(0.0, TABLE + CLOTH - z), CLOTH)
    return 2.5 * (pressed / CLOTH) ** 2 + rigid(z)


def cushion(z):
    return max(0.0, TABLE - z) * 600


def estimated(b, recording):
    b.convert("Pose2Height", "table", "height", recording)
    return estimate_height(b.trace(), HEIGHT, None)


def probe(bench, noise, surface, seed=0):
    b = bench(noise, seed)
    b.go("table_approach", (0.5, 0.0, 0.32))
    recording = b.descend(surface, "table")
    return estimated(b, recording)


@pytest.mark.parametrize(
    ("world", "tolerance"), [("none", 1e-5), ("lab", 3e-5), ("datasheet", 3e-5)]
)
def test_the_height_of_a_rigid_surface_is_identified(bench, noises, world, tolerance):
    for seed in range(5):
        found = probe(bench, noises[world], rigid, seed)
        assert found.values[0] == pytest.approx(TABLE, abs=tolerance)
        assert found.verdict == "identified"
        assert "soft onset" not in found.parts


def test_an_uncalibrated_arm_names_the_remedy(bench, noises):
    b = bench(noises["lab"], 0)
    b.go("table_approach", (0.5, 0.0, 0.32))
    b.convert("Pose2Height", "table", "height", b.descend(rigid, "table"))
    known, unknown = (
        estimate_height(b.trace(replace(HAND, tip_offset_std=std)), HEIGHT, None)
        for std in (2e-4, 5e-3)
    )
    assert "gauge" not in known.method
    assert "known to ± 10 mm (95 %)" in unknown.method
    assert "calibrate --gauge" in unknown.method
    assert unknown.stds[0] == pytest.approx(5e-3, rel=0.01)


def test_height_is_corrected_for_penetration(bench, noises):
    found = probe(bench, noises["none"], rigid)
    assert found.parts["penetration"].value == pytest.approx(8.0 / 4e4, rel=0.1)


def test_height_std_contains_the_pose_repeatability(bench, noises):
    assert probe(bench, noises["none"], rigid).stds[0] >= 1e-4


@pytest.mark.parametrize("world", ["none", "lab", "datasheet"])
def test_a_cloth_is_pressed_through(bench, noises, world):
    found = probe(bench, noises[world], cloth, 3)
    assert found.values[0] == pytest.approx(TABLE, abs=2e-4)
    assert found.verdict == "identified"
    onset = found.parts["soft onset"]
    assert abs(onset.value - (TABLE + CLOTH)) < 3 * onset.std
    assert "soft" in found.method


@pytest.mark.parametrize("world", ["none", "lab"])
def test_a_cushion_is_not_called_rigid(bench, noises, world):
    """A surface that gives way is contradicted: the scene calls it rigid."""
    found = probe(bench, noises[world], cushion)
    assert found.verdict == "contradicted"
    low, high = found.intervals[0]
    assert low <= TABLE <= high
    assert "gives way" in found.contradiction


@pytest.mark.parametrize("stiffness", [60, 300, 600, 1500, 3000, 12000])
def test_a_mat_with_a_steep_force_is_not_taken_for_a_table(bench, noises, stiffness):
    """All of its loading happens before the tip stops."""

    def mat(z):
        return max(0.0, TABLE + CLOTH - z) * stiffness

    found = probe(bench, noises["lab"], mat)
    assert found.verdict == "contradicted"
    assert abs(found.values[0] - (TABLE + CLOTH)) < 2 * found.stds[0]
    assert found.stds[0] >= 0.5 * found.parts["penetration"].value


@pytest.mark.parametrize("stiffness", [25e3, 33e3])
def test_a_light_table_is_carried_back_to_no_force_with_half_the_way_as_doubt(
    bench, noises, stiffness
):
    for seed in range(3):
        found = probe(bench, noises["lab"], lambda z: max(0.0, TABLE - z) * stiffness, seed)
        assert found.verdict == "identified"
        assert found.values[0] == pytest.approx(TABLE, abs=1e-4)
        assert found.stds[0] > 0.5 * found.parts["penetration"].value > 5e-5


def test_wild_samples_are_no_contact(bench, noises):
    """Torque sensors drop a wild sample now and then, in free air as well as in contact."""
    for seed in range(5):
        b = bench(noises["lab"], seed)
        b.go("table_approach", (0.5, 0.0, 0.32))
        recording = b.descend(rigid, "table")
        b.convert("Pose2Height", "table", "height", recording)
        trace = b.trace()
        random = np.random.default_rng(seed)
        wild = random.random(len(trace.samples)) < 0.03
        trace.samples.wrench[wild] += random.normal(0.0, 30.0, (int(wild.sum()), 6))
        found = estimate_height(trace, HEIGHT, None)
        assert found.values[0] == pytest.approx(TABLE, abs=5e-5)
        assert found.verdict == "identified"


def test_a_stop_in_free_air_is_no_height(bench, noises):
    b = bench(noises["lab"])
    b.go("table_approach", (0.5, 0.0, 0.32))
    begin = b.t
    for height in np.linspace(0.32, 0.29, 200):
        b.pressed(b.position, float(height), float(height), 0.0)
    b.leaf("MoveUntilContact", begin, "contact")
    recording = b.measure(0.3, "contact", "table", "gripper_pose")
    found = estimated(b, recording)
    assert found.verdict == "not identified"
    assert "nothing pressing back" in found.method


def closing(trace):
    """(3,) the direction in which the fingers close, world."""
    return Pose(np.zeros(3), trace.samples.pose_world_tcp[0, 3:]).rotation[:, 1]


@pytest.mark.parametrize("world", ["none", "lab", "datasheet"])
@pytest.mark.parametrize("side", [-1, 1])
def test_a_contact_of_one_finger_is_detected_by_its_moment(bench, noises, world, side):
    b = bench(noises[world], 2)
    b.go("table_approach", (0.5, 0.0, 0.32))
    beside = side * 0.045 * closing(b.trace())[:2]
    found = estimated(b, b.descend(rigid, "table", beside=beside))
    assert found.verdict == "contradicted"
    assert "One finger" in found.contradiction


@pytest.mark.parametrize("side", [-1, 1])
def test_a_hand_out_of_level_stands_on_one_finger_at_first(bench, noises, side):
    """An arm without calibration is out of level by milliradians, which its springs do not straighten."""
    b = bench(noises["lab"], 2)
    b.go("table_approach", (0.5, 0.0, 0.32))
    beside = side * 0.04 * closing(b.trace())[:2]
    recording = b.descend(rigid, "table", beside=beside)
    b.convert("Pose2Height", "table", "height", recording)
    trace = b.trace()
    unsure = replace(trace, hand=replace(trace.hand, tip_offset_std=1.6e-3))
    assert estimate_height(unsure, HEIGHT, None).verdict == "identified"


def leaning(trace, leans):
    """The trace, with a hand that leans over by `leans(force)` rad in the closing direction."""
    samples = trace.samples
    for i, force in enumerate(np.maximum(-samples.wrench[:, 2], 0.0).tolist()):
        turned = Pose.of(
            np.zeros(3), (np.cos(leans(force) / 2), np.sin(leans(force) / 2), 0.0, 0.0)
        )
        upright = Pose.of(np.zeros(3), samples.pose_world_tcp[i, 3:])
        samples.pose_world_tcp[i, 3:] = (upright @ turned).quaternion
    return trace


@pytest.mark.parametrize(
    ("most", "verdict"), [(0.0, "identified"), (1.8e-3, "identified"), (1.0, "contradicted")]
)
@pytest.mark.parametrize("side", [-1, 1])
def test_a_contact_of_one_finger_is_detected_by_the_tilt_of_the_hand(
    bench, noises, most, verdict, side
):
    """Where the joints' friction hides the moment. An arm that is out of level by a little stands on
    one finger until it has leant over by that."""
    rough = replace(noises["lab"], friction=3.0)
    b = bench(rough, 2)
    b.go("table_approach", (0.5, 0.0, 0.32))
    recording = b.descend(rigid, "table", threshold=30.0)
    b.convert("Pose2Height", "table", "height", recording)
    trace = leaning(b.trace(), lambda force: side * min(0.14e-3 * force, most))
    found = estimate_height(trace, HEIGHT, None)
    assert found.verdict == verdict
    assert ("leans over" in found.contradiction) == (verdict == "contradicted")


def test_an_arm_that_may_be_out_of_level_leans_over_where_it_touches(bench, noises):
    """A base that was levelled by eye: its owner says so, and the interval has room for it."""
    b = bench(noises["lab"], 2)
    b.go("table_approach", (0.5, 0.0, 0.32))
    recording = b.descend(rigid, "table", threshold=30.0)
    b.convert("Pose2Height", "table", "height", recording)
    trace = leaning(b.trace(replace(HAND, tip_offset_std=5e-3)), lambda force: 0.14e-3 * force)
    assert estimate_height(trace, HEIGHT, None).verdict == "identified"


@pytest.mark.parametrize("stiffness", [3000, 12000])
def test_a_mat_is_no_table_to_an_arm_whose_joints_rub(bench, noises, stiffness):
    """What they let go of as the arm stops hides half of the force, but not how it rose."""
    rough = replace(noises["lab"], friction=2.0)
    for seed in range(4):
        found = probe(bench, rough, lambda z: max(0.0, TABLE + CLOTH - z) * stiffness, seed)
        assert found.verdict == "contradicted"
        assert "give" in found.contradiction


def test_compliance_of_the_tips_is_not_that_of_the_surface(bench, noises):
    """Rubber pads under a hand whose owner says so."""
    b = bench(noises["lab"])
    b.go("table_approach", (0.5, 0.0, 0.32))
    recording = b.descend(lambda z: max(0.0, TABLE - z) * 11e3, "table")
    b.convert("Pose2Height", "table", "height", recording)
    verdicts = []
    for compliance in (0.0, 5e-5):
        hand = replace(HAND, tip_compliance=compliance, tip_compliance_std=1e-5)
        verdicts.append(estimate_height(b.trace(hand), HEIGHT, None).verdict)
    assert verdicts == ["contradicted", "identified"]


def test_friction_that_changes_with_the_place_is_no_finger_and_no_contact(bench, noises):
    """An arm whose joints bear several tenths of a newton metre more here than there."""
    rough = replace(noises["lab"], slope=15.0, friction=0.8)
    for seed in range(6):
        found = probe(bench, rough, rigid, seed)
        assert found.verdict == "identified"
        assert found.values[0] == pytest.approx(TABLE, abs=2e-4)
        assert "soft onset" not in found.parts


@pytest.mark.parametrize("start", [0.03, 0.06, 0.12])
def test_the_height_of_a_cushion_does_not_depend_on_the_start_of_the_probe(bench, noises, start):
    b = bench(noises["lab"])
    b.go("table_approach", (0.5, 0.0, TABLE + HAND.tip_offset + start))
    recording = b.descend(lambda z: max(0.0, TABLE - z) * 200, "table")
    found = estimated(b, recording)
    assert found.verdict == "contradicted"
    assert found.values[0] == pytest.approx(TABLE, abs=2.5e-3)


def test_the_length_of_the_tips_is_as_uncertain_as_stated(bench, noises):
    b = bench(noises["none"])
    b.go("table_approach", (0.5, 0.0, 0.32))
    b.convert("Pose2Height", "table", "height", b.descend(rigid, "table"))
    stds = []
    for std in (0.0, 5e-4):
        trace = b.trace(replace(HAND, tip_offset_std=std))
        stds.append(float(estimate_height(trace, HEIGHT, None).stds[0]))
    assert stds[1] == pytest.approx(np.hypot(stds[0], 5e-4), rel=1e-3)


def touch_all(bench, noise, spots, press, seed=0):
    """One touch a spot; the last is the one that is converted."""
    b = bench(noise, seed)
    recording = None
    for x, y in spots:
        b.go("table_approach", (x, y, 0.32))
        recording = b.descend(lambda z, x=x, y=y: press(x, y, z), "table")
    return estimated(b, recording)


CORNERS = ((0.45, -0.05), (0.55, -0.05), (0.5, 0.07))


def test_several_touches_make_one_height(bench, noises):
    """The tips are the same ones; the rest averages out."""
    once = probe(bench, noises["lab"], rigid)
    found = touch_all(bench, noises["lab"], CORNERS, lambda x, y, z: rigid(z))
    assert found.values[0] == pytest.approx(TABLE, abs=5e-5)
    assert found.verdict == "identified"
    assert len(found.evidence) == 3
    assert HAND.tip_offset_std < found.stds[0] < once.stds[0]
    assert found.parts["tilt"].value < 3 * found.parts["tilt"].std


def test_three_touches_show_how_a_table_leans(bench, noises):
    slope = np.tan(np.radians(1.0))

    def leaning(x, y, z):
        return rigid(z - slope * (x - 0.5))

    found = touch_all(bench, noises["lab"], CORNERS, leaning)
    tilt = found.parts["tilt"]
    assert tilt.value == pytest.approx(np.radians(1.0), abs=2 * tilt.std)
    middle = float(np.mean([x for x, _ in CORNERS]))
    assert abs(found.values[0] - TABLE - slope * (middle - 0.5)) < found.stds[0]
    assert found.stds[0] > slope * 0.04
    assert "leans" in found.method


def test_touches_that_disagree_contradict_each_other(bench, noises):
    """A board under the second of two touches."""

    def board(x, y, z):
        return rigid(z - 0.006 * (x > 0.5))

    found = touch_all(bench, noises["lab"], CORNERS[:2], board)
    assert found.verdict == "contradicted"
    assert "do not agree" in found.contradiction


def test_a_stop_on_impact_needs_no_loading_curve(bench, noises):
    """A hard knock stops the arm at once: it then rests on the table with hardly any force."""
    b = bench(noises["lab"], 1)
    b.go("table_approach", (0.5, 0.0, 0.32))
    recording = b.descend(lambda z: max(0.0, TABLE - z) * 4e6, "table", threshold=1.5)
    found = estimated(b, recording)
    assert found.values[0] == pytest.approx(TABLE, abs=5e-5)
    assert found.verdict == "identified"


def test_tilted_hand_touches_with_its_lower_finger(bench, noises):
    b = bench(noises["none"])
    b.go("table_approach", (0.5, 0.0, 0.32))
    recording = b.descend(rigid, "table")
    b.convert("Pose2Height", "table", "height", recording)
    trace = b.trace()
    straight = estimate_height(trace, HEIGHT, None).values[0]
    half = np.radians(5.0) / 2
    tilt = np.array([0.0, 1.0, 0.0, 0.0]) * np.cos(half) + np.array([1.0, 0.0, 0.0, 0.0]) * np.sin(
        half
    )
    trace.samples.pose_world_tcp[:, 3:] = tilt
    tilted = estimate_height(trace, HEIGHT, None).values[0]
    assert straight - tilted == pytest.approx(0.04 * np.sin(np.radians(5.0)), abs=1e-4)


def test_no_descent_is_an_error(bench, noises):
    b = bench(noises["none"])
    b.go("table_approach", (0.5, 0.0, 0.32))
    recording = Recording("gripper_pose", 0.1, 0.3, Where("contact", support="table"))
    with pytest.raises(ValueError, match="no guarded descent"):
        estimated(b, recording)


TILT = Parameter("table", "tilt")
TILTED_SPOTS = ((0.45, -0.05), (0.55, -0.05), (0.45, 0.05))
SCENE = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="table" pos="0.5 0 ?"><geom type="box" size=".4 .5 .02"/></body>
  <body name="can" pos="0.5 -0.15 0.05"><freejoint/><geom type="cylinder" size=".03 .05"/></body>
</worldbody></mujoco>"""


def touch_tilted(bench, noise, spots, slope, seed=0):
    """One touch a spot of a table that rises by `slope` along x and y."""
    b = bench(noise, seed)
    for x, y in spots:
        top = TABLE + slope[0] * (x - 0.5) + slope[1] * y
        b.go("table_approach", (x, y, 0.32))
        b.descend(lambda z, top=top: max(0.0, top - z) * 4e4, "table")
    return estimate_tilt(b.trace(), TILT, None)


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.01, 0.0), (-0.02, 0.015)])
@pytest.mark.parametrize("noise", ["none", "lab", "datasheet"])
def test_three_touches_measure_the_tilt_of_a_table(bench, noises, noise, slope):
    found = touch_tilted(bench, noises[noise], TILTED_SPOTS, slope)
    assert found.verdict == "identified"
    assert found.values == pytest.approx(slope, abs=1e-3)
    assert np.abs(found.z_score(slope)).max() < 3.0
    assert found.parts["angle"].value == pytest.approx(np.hypot(*slope), abs=1.5e-3)


@pytest.mark.parametrize("spots", [TILTED_SPOTS[:2], ((0.45, 0.0), (0.5, 0.0), (0.55, 0.0))])
def test_touches_in_line_measure_no_tilt(bench, noises, spots):
    found = touch_tilted(bench, noises["lab"], spots, (0.01, 0.0))
    assert found.verdict == "not identified"
    assert "not in line" in found.method


def test_a_plan_for_a_tilt_touches_three_spots():
    scene = parse_scene(SCENE)
    plan = SymbolicPlanner().plan("how much is the table tilted?", scene)
    assert plan.parameters == (TILT,)
    kinds = [node.type for _, node in plan.tree.walk()]
    assert kinds.count("MoveUntilContact") == kinds.count("MeasureGripperPose") == 3


def test_a_plan_for_a_height_touches_once():
    plan = SymbolicPlanner().plan("how high is the table?", parse_scene(SCENE))
    kinds = [node.type for _, node in plan.tree.walk()]
    assert kinds.count("MoveUntilContact") == 1
