"""What an arm carried, from recordings: simulated with known loads, and of real arms."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.common.errors import InputError
from palpate.estimation.logs.reading import read_log
from palpate.estimation.rigid_bodies import load_torques
from palpate.robots.owner import load_description

from .conftest import COM, INERTIA, MASS, WINDOW, Log

REAL = Path(os.environ.get("PALPATE_SHARED", Path(__file__).parents[4] / "shared")) / "real"
ARM = load_description("fr3")
SCENE = """<mujoco><worldbody><site name="robot_base"/>
<body name="drill" pos="0.5 0 0.06"><freejoint/>
<inertial pos="? ? ?" mass="?" diaginertia="? ? ?"/><geom type="box" size=".04 .03 .06"/></body>
</worldbody></mujoco>"""


@pytest.fixture(scope="module")
def found(npz: Path) -> pp.Run:
    return pp.estimate(npz, [WINDOW])


def inside(estimate: pp.Estimate, truth: np.ndarray | tuple[float, ...] | float) -> bool:
    """The truth lies within three standard deviations."""
    return bool((np.abs(estimate.z_score(truth)) < 3.0).all())


def test_mass_centre_and_inertia_lie_within_their_intervals(found: pp.Run) -> None:
    mass, com, inertia = (found[f"load.{name}"] for name in ("mass", "com", "inertia"))
    assert mass.identified
    assert inside(mass, MASS)
    assert mass.stds[0] < 0.01
    assert com.identified
    assert inside(com, COM)
    assert inside(inertia, (*INERTIA, 0.0, 0.0, 0.0))
    assert found.status == "complete"
    assert not found.simulated


def test_the_hand_is_weighed_or_stated(npz: Path) -> None:
    weighed = pp.estimate(npz, [WINDOW], hand="found")
    assert inside(weighed["hand.mass"], 0.73)
    assert inside(weighed["load.mass"], MASS)
    # A hand that is believed to be heavier than it is shows in neither: the empty motion has it, too.
    stated = pp.estimate(npz, [WINDOW], hand=0.8)
    assert inside(stated["load.mass"], MASS)


def test_an_estimate_without_the_empty_hand_includes_the_arms_errors(
    npz: Path, recording: Log
) -> None:
    rows = recording["t"] > WINDOW[0] + 3.0
    alone = npz.parent / "alone.npz"
    np.savez(alone, **{name: values[rows] for name, values in recording.items()})
    found = pp.estimate(alone)["load.mass"]
    assert found.verdict == "prior-dominated"
    assert inside(found, MASS)
    empty = npz.parent / "empty.npz"
    np.savez(empty, **{name: values[recording["t"] < 14.5] for name, values in recording.items()})
    compared = pp.estimate(alone, empty=empty)["load.mass"]
    assert compared.identified
    assert inside(compared, MASS)
    assert compared.stds[0] < found.stds[0]


def test_a_load_that_came_and_went_is_contradicted(npz: Path) -> None:
    found = pp.estimate(npz, [(4.0, 20.0)])["load.mass"]
    assert found.verdict == "contradicted"
    assert "differs between parts" in found.contradiction
    carried_elsewhere = pp.estimate(npz, [(12.4, 17.0)])["load.mass"]
    assert carried_elsewhere.verdict == "contradicted"


@pytest.mark.parametrize(
    ("factor", "cause"),
    [
        (-1.0, "have the opposite sign: negate them"),
        (1000.0, "give N m at the joints, not mN m"),
        (1.0 / 7.0, "not mN m, motor currents"),
    ],
)
def test_torques_that_the_arm_does_not_explain_are_contradicted(
    recording: Log, tmp_path: Path, factor: float, cause: str
) -> None:
    file = tmp_path / "wrong.npz"
    np.savez(file, **{**recording, "tau": factor * recording["tau"]})
    run = pp.estimate(file, [WINDOW])
    mass = run["load.mass"]
    assert run.status == "failed"
    assert mass.verdict == "contradicted"
    assert cause in mass.contradiction
    assert mass.intervals[0, 0] < mass.values[0] < mass.intervals[0, 1]
    # One message: what follows from the mass says no more.
    for name in ("com", "inertia"):
        assert run[f"load.{name}"].verdict == "not identified"
        assert "mass is contradicted" in run[f"load.{name}"].method


def test_a_load_of_less_than_nothing_is_contradicted(npz: Path) -> None:
    """The empty hand's window, said to be loaded."""
    mass = pp.estimate(npz, [(0.5, 11.5)])["load.mass"]
    low, high = mass.intervals[0]
    assert low < -MASS < high < 0.0
    assert mass.verdict == "contradicted"
    assert "weighs less than nothing: the windows" in mass.contradiction


def test_a_load_beyond_the_payload_is_contradicted(recording: Log, tmp_path: Path) -> None:
    """The load and ten times as much: 4.4 kg, at FR3's payload of 3 kg."""
    held = recording["t"] > 15.0
    chain = ARM.nominal.chain
    assert chain is not None
    more = load_torques(
        chain, recording["q"], recording["dq"], 0 * recording["q"], np.array([0, 0, -9.81])
    )
    file = tmp_path / "heavy.npz"
    tau = recording["tau"] + np.where(held[:, None], more[:, :, 0] * 4.0, 0.0)
    np.savez(file, **{**recording, "tau": tau})
    mass = pp.estimate(file, [WINDOW])["load.mass"]
    assert mass.verdict == "contradicted"
    assert "payload of 3 kg" in mass.contradiction


@pytest.mark.parametrize("gain", [0.99, 1.01])
def test_an_error_that_all_sensors_share_is_in_the_interval(
    recording: Log, tmp_path: Path, gain: float
) -> None:
    file = tmp_path / "gain.npz"
    np.savez(file, **{**recording, "tau": gain * recording["tau"]})
    mass = pp.estimate(file, [WINDOW])["load.mass"]
    assert mass.identified
    assert mass.intervals[0, 0] < MASS < mass.intervals[0, 1]
    assert "gain of all joints" in {one.cause for one in mass.shared}


def test_a_recording_of_another_arm_is_refused_by_its_range(npz: Path) -> None:
    with pytest.raises(InputError, match=r"joint 4 is at .* 'iiwa14' turns it from -2.09 to"):
        pp.estimate(npz, [WINDOW], arm="iiwa14")


def test_the_twin_of_a_scene(npz: Path, tmp_path: Path) -> None:
    scene = tmp_path / "scene.xml"
    scene.write_text(SCENE)
    with pytest.raises(InputError, match="a scene needs object="):
        pp.estimate(npz, [WINDOW], scene=scene)
    with pytest.raises(InputError, match="did you mean 'drill'"):
        pp.estimate(npz, [WINDOW], scene=scene, object="dril")
    mass = pp.estimate(npz, [WINDOW], scene=scene, object="drill")
    assert [str(one.parameter) for one in mass.estimates] == ["drill.mass"]
    # The object's frame is 20 mm beyond the TCP, turned by half a turn about the tool.
    run = pp.estimate(npz, [WINDOW], scene=scene, object="drill", in_hand=(0, 0, 0.02, 0, 0, 0, 1))
    assert inside(run["drill.com"], (-COM[0], -COM[1], COM[2] - 0.02))
    saved = run.save(tmp_path / "run")
    twin = (tmp_path / "run" / "twin.xml").read_text()
    (written,) = re.findall(r'mass="([^"]*)"', twin)
    assert float(written) == pytest.approx(float(run["drill.mass"]), abs=5e-5)
    again = pp.open(tmp_path / "run")
    assert again.status == "complete"
    assert again.estimate()["drill.mass"] == saved["drill.mass"]
    result = json.loads((tmp_path / "run" / "result.json").read_text())
    assert result["parameters"][0]["verdict"] == "identified"
    page = (tmp_path / "run" / "report.html").read_text("utf-8")
    assert not any(f">{what}<" in page for what in ("Seed", "seed", "Sensor noise", "Reproduce"))


@pytest.mark.parametrize(
    ("mass", "remeasure", "kept"), [("0.7", False, True), ("0.7", True, False), ("?", False, False)]
)
def test_a_stated_value_is_replaced_on_request_only(
    npz: Path, tmp_path: Path, mass: str, remeasure: bool, kept: bool
) -> None:
    scene = tmp_path / "scene.xml"
    scene.write_text(SCENE.replace('mass="?"', f'mass="{mass}"'))
    run = pp.estimate(npz, [WINDOW], scene=scene, object="drill", remeasure=remeasure)
    # The measured value is reported in any case; the twin has the stated one unless it is asked for.
    assert inside(run["drill.mass"], MASS)
    expected = 0.7 if kept else run["drill.mass"].value
    assert run.twin is not None
    assert run.twin.mjmodel.body("drill").mass[0] == pytest.approx(expected, rel=1e-3)
    notes = " ".join(run.plan.notes)
    assert ("'drill' is stated by the scene (0.7 kg)" in notes) == (mass != "?")
    assert ("the twin keeps it, without --remeasure" in notes) == kept
    assert run.status == "complete"
    # A folder keeps the choice.
    again = pp.open(run.save(tmp_path / "run").folder or "")
    assert again.twin is not None
    assert again.twin.mjmodel.body("drill").mass[0] == pytest.approx(expected, rel=1e-3)


def test_a_single_window_needs_no_list(npz: Path) -> None:
    one, listed = pp.estimate(npz, loaded=WINDOW), pp.estimate(npz, loaded=[WINDOW])
    assert one["load.mass"].value == listed["load.mass"].value
    assert len(one) == len(one.estimates) > 0


def test_windows_outside_of_the_recording_are_refused(npz: Path) -> None:
    with pytest.raises(InputError, match=r"loaded=30-40: log.npz lasts 24.0 s"):
        pp.estimate(npz, [(30.0, 40.0)])


@pytest.mark.parametrize("window", [(-3.0, 13.0), (4.0, 26.0), (float("nan"), 13.0)])
def test_windows_partly_outside_of_the_recording_are_refused(
    npz: Path, window: tuple[float, float]
) -> None:
    with pytest.raises(
        InputError, match=r"loaded=.*: log.npz lasts 24.0 s; give windows within it"
    ):
        pp.estimate(npz, [window])


@pytest.mark.parametrize(
    "pose", ["up", (0, 0, 0, 0, 0, 0, 0), (0, 0, 50), (0, 0, float("nan")), (0, 0)]
)
def test_invalid_poses_in_the_hand_are_refused(npz: Path, pose: str | tuple[float, ...]) -> None:
    with pytest.raises(InputError, match=r"in_hand='.*': give X Y Z in m, at most 2"):
        pp.estimate(npz, [WINDOW], in_hand=pose)


@pytest.mark.parametrize("hand", ["fund", "0.7", True, -1.0, 700.0, float("nan")])
def test_invalid_hands_are_refused(npz: Path, hand: Any) -> None:
    with pytest.raises(InputError, match=r"hand=.*: give a number of kg, 0 to 50, or 'found'"):
        pp.estimate(npz, [WINDOW], hand=hand)


@pytest.mark.skipif(not REAL.is_dir(), reason="recordings of real arms are not at hand")
def test_the_estimate_for_a_real_empty_hand_is_zero(tmp_path: Path) -> None:
    """Parts of a real FR3's motion with the empty hand, said to be loaded: zero lies in the intervals, and the
    answer is a limit."""
    data = np.load(REAL / "fr3_free_1.npz")
    step = {"q": 1e-6, "dq": 1e-5, "tau": 1e-4}
    signals = {key: np.cumsum(data[f"{key}_steps"], axis=0) * size for key, size in step.items()}
    file = tmp_path / "fr3.npz"
    np.savez(file, t=np.cumsum(data["dt_us"].astype(float)) * 1e-6, **signals)
    (note,) = read_log(file).notes
    assert "repeat the one before" in note
    highest: list[float] = []
    for start in (0.5, 2.0, 3.5, 5.0, 6.5):
        mass = pp.estimate(file, [(start, start + 3.0)])["load.mass"]
        assert mass.ci95[0] < 0.0 < mass.ci95[1]
        assert mass.doubt.startswith("at most 0.0")
        assert not mass.identified
        highest.append(mass.limits[0])
    assert max(highest) < 0.08
