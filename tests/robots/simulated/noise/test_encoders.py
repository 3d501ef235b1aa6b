"""Joint angles as the encoders tell them."""

from __future__ import annotations

import numpy as np
import pytest
from noises import JACOBIAN, model

from palpate.robots.simulated.noise.disturbances import Rests
from palpate.robots.simulated.noise.encoders import Encoders
from palpate.robots.simulated.noise.values import Streams


def encoders(seed: int = 0, **sections: object) -> Encoders:
    noise, streams = model(**sections), Streams(seed)
    return Encoders(noise, Rests(noise.sticking, noise.pose, 0.005, streams), streams)


Q = np.linspace(-1.0, 1.0, 7)[None]


def test_perfect_encoders_report_true_angles() -> None:
    found = encoders()
    assert found.exact
    assert found.clean
    assert found.reported(Q, np.full((1, 7), 20.0)) is Q
    assert not found.pose_error.any()


def test_joints_give_way_behind_the_encoders() -> None:
    found = encoders(model={"joint_compliance": {"fixed": 1e-4}})
    off = found.reported(Q, np.full((1, 7), 20.0)) - Q
    assert off == pytest.approx(np.full((1, 7), 2e-3))


def test_compliance_is_never_negative() -> None:
    drawn = [
        encoders(seed, model={"joint_compliance": 1e-4}).reported(Q, np.ones((1, 7))) - Q
        for seed in range(100)
    ]
    assert np.min(drawn) >= 0
    assert np.sqrt(np.mean(np.square(drawn))) == pytest.approx(1e-4, rel=0.1)


def test_ripple_repeats_around_a_turn() -> None:
    found = encoders(pose={"encoder_ripple": {"size": 1e-4, "cycles": 8}})
    turn = np.outer(np.linspace(0, 2 * np.pi, 800, endpoint=False), np.ones(7))
    off = found.reported(turn, np.zeros((800, 7))) - turn
    assert off.std(0) == pytest.approx(np.full(7, 1e-4), rel=1e-3)


def test_noise_is_that_of_a_mean_of_five_samples() -> None:
    noise = encoders(pose={"encoder": 1e-5}).noise(4000)
    assert noise is not None
    assert noise.std() == pytest.approx(1e-5 / np.sqrt(5), rel=0.03)


def test_angles_come_in_steps() -> None:
    found = encoders(pose={"quantisation": 0.01})
    assert found.quantised(np.array([[0.123]])) == pytest.approx(np.array([[0.12]]))


def test_the_arm_goes_on_while_its_pads_give_way() -> None:
    found = encoders(model={"pad_compliance": {"fixed": 1e-4}})
    down = np.array([0.0, 0.0, -1.0])
    more = found.pressed(JACOBIAN, np.full(100, 10.0), down)
    assert (JACOBIAN @ more[-1])[:3] == pytest.approx(1e-3 * down, abs=1e-7)
    assert (JACOBIAN @ more[-1])[3:] == pytest.approx(np.zeros(3), abs=1e-7)
    assert np.linalg.norm(more[3]) == pytest.approx(0.632 * np.linalg.norm(more[-1]), rel=0.01)
    pulled = found.pressed(JACOBIAN, np.full(100, -10.0), down)
    assert np.abs(pulled[-1]).max() < 1e-8, "pulling does not"


def test_links_warm_up_and_cool_down() -> None:
    errors: list[np.ndarray] = []
    for seed in range(200):
        found = encoders(seed, pose={"thermal": 1e-4})
        errors.append(found.pose_error.copy())
    assert np.std(errors) == pytest.approx(1e-4, rel=0.1)
    found.pass_time(60_000)
    assert (found.pose_error != errors[-1]).all()
