"""Height: rigid tables, cloths on them, cushions."""

import numpy as np
import pytest

from palpate.parameter import Parameter
from palpate.quantities.height import estimate_height
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
def test_rigid_surface(bench, noises, world, tolerance):
    for seed in range(5):
        found = probe(bench, noises[world], rigid, seed)
        assert found.value[0] == pytest.approx(TABLE, abs=tolerance)
        assert found.verdict == "identified"
        assert "soft onset" not in found.parts


def test_penetration_is_corrected(bench, noises):
    found = probe(bench, noises["none"], rigid)
    assert found.parts["penetration"].value == pytest.approx(8.0 / 4e4, rel=0.1)


def test_pose_repeatability_enters_the_standard_deviation(bench, noises):
    assert probe(bench, noises["none"], rigid).std[0] >= 1e-4


@pytest.mark.parametrize("world", ["none", "lab", "datasheet"])
def test_a_cloth_is_pressed_through(bench, noises, world):
    found = probe(bench, noises[world], cloth, 3)
    assert found.value[0] == pytest.approx(TABLE, abs=2e-4)
    assert found.verdict == "identified"
    onset = found.parts["soft onset"]
    assert abs(onset.value - (TABLE + CLOTH)) < 3 * onset.std
    assert "soft" in found.method


@pytest.mark.parametrize("world", ["none", "lab"])
def test_a_cushion_is_not_called_rigid(bench, noises, world):
    found = probe(bench, noises[world], cushion)
    assert found.verdict == "prior-dominated"
    low, high = found.ci95[0]
    assert low <= TABLE <= high
    assert "gives way" in found.method


def test_a_stop_on_impact_needs_no_loading_curve(bench, noises):
    """A hard knock stops the arm at once: it then rests on the table with hardly any force."""
    b = bench(noises["lab"], 1)
    b.go("table_approach", (0.5, 0.0, 0.32))
    recording = b.descend(lambda z: max(0.0, TABLE - z) * 4e6, "table", threshold=1.5)
    found = estimated(b, recording)
    assert found.value[0] == pytest.approx(TABLE, abs=5e-5)
    assert found.verdict == "identified"


def test_tilted_hand_touches_with_its_lower_finger(bench, noises):
    b = bench(noises["none"])
    b.go("table_approach", (0.5, 0.0, 0.32))
    recording = b.descend(rigid, "table")
    b.convert("Pose2Height", "table", "height", recording)
    trace = b.trace()
    straight = estimate_height(trace, HEIGHT, None).value[0]
    half = np.radians(5.0) / 2
    tilt = np.array([0.0, 1.0, 0.0, 0.0]) * np.cos(half) + np.array([1.0, 0.0, 0.0, 0.0]) * np.sin(
        half
    )
    trace.samples.pose_world_tcp[:, 3:] = tilt
    tilted = estimate_height(trace, HEIGHT, None).value[0]
    assert straight - tilted == pytest.approx(0.04 * np.sin(np.radians(5.0)), abs=1e-4)


def test_no_descent_is_an_error(bench, noises):
    b = bench(noises["none"])
    b.go("table_approach", (0.5, 0.0, 0.32))
    recording = Recording("gripper_pose", 0.1, 0.3, Where("contact", support="table"))
    with pytest.raises(ValueError, match="no guarded descent"):
        estimated(b, recording)
