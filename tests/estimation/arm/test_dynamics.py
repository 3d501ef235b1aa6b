"""Dynamics of an arm from a recording: simulated ones with a friction of another law, and real ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from moving_arm import COULOMB, OFFSET, VISCOUS, recorded
from mujoco import MjModel

from palpate.common.errors import InputError
from palpate.estimation.arm_dynamics import JointFigure, identify
from palpate.estimation.logs.reading import read_log
from palpate.robots.owner import load_description
from palpate.trace.recording import ArmLog
from palpate.twin.arm import save_arm

ARM = load_description("fr3")
REAL = Path(__file__).parents[4] / "shared" / "real"


def deviations(figure: JointFigure, true: np.ndarray) -> np.ndarray:
    return np.abs((figure.value - true) / figure.std)


def test_friction_and_hand_are_within_their_intervals() -> None:
    hands: list[float] = []
    for seed in range(3):
        found = identify(recorded(ARM, 1.1, seed=seed), ARM)
        assert found.hand is not None
        hands.append((found.hand.mass - 1.1) / found.hand.mass_std)
        assert found.hand.mass_std < 0.05
        for figure, true in (
            (found.coulomb, COULOMB),
            (found.viscous, VISCOUS),
            (found.offset, OFFSET),
            (found.armature, np.zeros(7)),
        ):
            assert np.sqrt((deviations(figure, true) ** 2).mean()) < 1.5
            assert deviations(figure, true).max() < 3.5
        assert (found.coulomb.std < 0.15 * COULOMB + 0.01).all()
    assert np.abs(hands).max() < 2.6


def test_identified_dynamics_predict_the_rest_of_the_recording() -> None:
    found = identify(recorded(ARM, 0.76), ARM)
    described, friction, everything = (
        np.sqrt((found.rms[name] ** 2).mean()) for name in ("described", "friction", "all")
    )
    assert friction < 0.3 * described
    assert everything <= 1.1 * friction
    assert "controller" not in found.rms, "this log has no tau_ext"


def test_a_bare_flange_is_stated() -> None:
    found = identify(recorded(ARM, 1e-6), ARM, hand=0.0)
    assert found.hand is None
    assert deviations(found.coulomb, COULOMB).max() < 3.5


def test_a_joint_at_rest_is_not_observed() -> None:
    moving = recorded(ARM, 0.76, seconds=20.0)
    still = np.arange(7) == 2
    rest = ARM.home.copy()
    log = ArmLog(
        moving.t,
        np.where(still, rest, moving.q),
        np.where(still, 0.0, moving.dq),
        moving.tau,
        None,
        "one joint rests",
    )
    found = identify(log, ARM)
    assert found.coulomb.observed == (True, True, False, True, True, True, True)
    assert found.coulomb.record(2) is None


def test_a_joint_that_turns_one_way_only_is_not_observed() -> None:
    """Its friction is no other than an offset."""
    moving = recorded(ARM, 0.76, seconds=10.0)
    only = np.arange(7) == 6
    dq = np.where(only, 0.05, moving.dq)
    q = np.where(only, ARM.home + 0.05 * moving.t[:, None], moving.q)
    tau = moving.tau + np.where(only, 0.15, 0.0)
    found = identify(ArmLog(moving.t, q, dq, tau, None, "one way"), ARM)
    assert found.coulomb.observed == (True,) * 6 + (False,)
    assert found.coulomb.record(6) is None


def test_figures_that_no_arm_has_are_contradicted(tmp_path: Path) -> None:
    log = recorded(ARM, 0.76, seconds=10.0)
    negative = replace(log, tau=log.tau - 2.0 * (COULOMB * np.tanh(log.dq / 0.02)))
    found = identify(negative, ARM)
    (finding,) = found.contradictions
    assert finding.startswith("Friction is negative: -0.")
    assert "(joint 1)" in finding
    assert found.record()["contradictions"] == [finding]
    with pytest.raises(InputError, match=r"arm\.xml is not written: Friction is negative"):
        save_arm(found, tmp_path / "arm.xml")
    assert not (tmp_path / "arm.xml").exists()
    sound = identify(log, ARM)
    assert sound.contradictions == ()
    # A sensor that only the description mounts is not in the arm's file.
    with pytest.raises(InputError, match=r"'fr3-ft' mounts a sensor that arm\.xml does not have"):
        save_arm(replace(sound, arm=load_description("fr3-ft")), tmp_path / "arm.xml")


def test_a_recording_that_the_arm_does_not_explain_is_contradicted() -> None:
    log = recorded(ARM, 0.76, seconds=10.0)
    (finding,) = identify(replace(log, tau=-log.tau), ARM).contradictions
    assert "have the opposite sign: negate them" in finding
    (finding,) = identify(
        recorded(load_description("iiwa14"), 0.76, seconds=10.0), ARM
    ).contradictions
    assert "another arm" in finding


def test_a_hand_of_no_weight_has_no_centre(tmp_path: Path) -> None:
    found = identify(recorded(ARM, 1e-6, seconds=10.0), ARM)
    assert found.hand is not None
    assert found.hand.centre is None
    assert found.hand.record()["centre"] is None
    save_arm(found, tmp_path / "arm.xml")
    written, given = (MjModel.from_xml_path(str(path)) for path in (tmp_path / "arm.xml", ARM.mjcf))
    assert written.body(ARM.hand.body).ipos == pytest.approx(given.body(ARM.hand.body).ipos)


def test_bad_recordings_are_refused() -> None:
    log = recorded(ARM, 0.76, seconds=10.0)
    short = ArmLog(log.t[:751], log.q[:751], log.dq[:751], log.tau[:751], None, "short.csv")
    with pytest.raises(InputError, match=r"short\.csv has 3\.0 s .* at least 5 s"):
        identify(short, ARM)
    rest = np.broadcast_to(ARM.home, log.q.shape)
    with pytest.raises(InputError, match="no joint moves"):
        identify(ArmLog(log.t, rest, 0 * log.dq, log.tau, None, "rest.csv"), ARM)
    slow = slice(None, None, 25)
    with pytest.raises(InputError, match=r"a row every 0\.1 s"):
        identify(ArmLog(log.t[slow], log.q[slow], log.dq[slow], log.tau[slow], None, "slow"), ARM)
    with pytest.raises(InputError, match="hand of -1 kg"):
        identify(log, ARM, hand=-1.0)


@pytest.mark.skipif(not REAL.is_dir(), reason="recordings of real arms are not here")
def test_the_hand_of_a_real_arm_is_weighed(tmp_path: Path) -> None:
    """An FR3 with its hand of 0.73 kg, 10 s; torque of its last 4 s by what was found before."""
    packed, steps = np.load(REAL / "fr3_free_1.npz"), {"q": 1e-6, "dq": 1e-5, "tau": 1e-4}
    signals = {
        name: np.cumsum(packed[f"{name}_steps"], axis=0) * step for name, step in steps.items()
    }
    np.savez(tmp_path / "log.npz", t=np.cumsum(packed["dt_us"].astype(float)) * 1e-6, **signals)
    found = identify(read_log(tmp_path / "log.npz"), ARM)
    assert found.hand is not None
    low, high = found.hand.interval
    assert low < 0.73 < high
    assert found.hand.mass_std < 0.04
    rms = {name: float(np.sqrt((value**2).mean())) for name, value in found.rms.items()}
    assert rms["all"] < rms["friction"] < rms["described"]


@pytest.mark.skipif(not REAL.is_dir(), reason="recordings of real arms are not here")
def test_friction_of_another_real_arm_predicts_its_torque() -> None:
    """A Panda without a hand, 24 s at 30 Hz, by the description of an FR3."""
    found = identify(read_log(REAL / "panda_free.npz"), ARM, hand=0.0)
    rms = {name: float(np.sqrt((value**2).mean())) for name, value in found.rms.items()}
    assert rms["friction"] < 0.7 * rms["described"]
    assert rms["all"] < 0.7 * rms["described"]
