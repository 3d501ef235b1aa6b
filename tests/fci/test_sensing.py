"""What a served arm feels is what the embedded one would: the same drawn robot."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.common.pose import Array
from palpate.robots.simulated.noise.model import Streams
from palpate.robots.simulated.noise.models import noise_models

from .bench import Setup, Workbench
from .served import files, own_address

PUSH = np.array([0.0, 0.0, -10.0])
"""N, on the hand, world axes."""


def bench(noise: str, seed: int = 0) -> Workbench:
    made = Workbench(
        Setup(**files("bottle_and_table"), noise=noise, seed=seed, address=own_address())
    )
    made.server.close()
    return made


def rest(made: Workbench, cycles: int, push: Array | None = None) -> Array:
    """(cycles, 7) N m, measured while it stands, and somebody pulls at the hand."""
    plant, out = made.plant, np.empty((cycles, 7))
    if push is not None:
        plant.pull(push)
    for i in range(cycles):
        made.robot.cycle(None)
        out[i] = made.robot.state.fields["tau_J"]
    return out


def test_a_perfect_arm_feels_what_pulls_at_it() -> None:
    """What pulls down is borne: the robot exerts as much upwards."""
    made = bench("none")
    rest(made, 50)
    assert np.abs(made.robot.state.fields["O_F_ext_hat_K"]).max() < 0.05
    rest(made, 500, PUSH)
    assert made.robot.state.fields["O_F_ext_hat_K"][:3] == pytest.approx(-PUSH, abs=0.05)


def test_the_noise_of_single_cycles_is_the_models() -> None:
    made = bench("lab")
    white = noise_models().load("lab").torque.white
    readings = rest(made, 1500)
    assert np.diff(readings, axis=0).std(axis=0) / np.sqrt(2) == pytest.approx(white, rel=0.1)


@pytest.mark.parametrize("seed", [3, 4])
def test_the_gains_are_those_of_the_robot_with_this_seed(seed: int) -> None:
    """Of the fourth joint, which a pull loads most: -0.0001 and +0.0073."""
    model = noise_models().load("datasheet")
    drawn = model.torque.gain_max.draw(Streams(seed)("torque.gain_max"))
    made = bench("datasheet", seed)
    before = rest(made, 400)[200:].mean(axis=0)
    true = made.plant.link.copy()
    after = rest(made, 800, 3 * PUSH)[400:].mean(axis=0)
    felt, given = after - before, made.plant.link - true
    assert felt[3] / given[3] - 1.0 == pytest.approx(drawn[3], abs=0.004)


def test_a_held_arm_stands_still_in_spite_of_encoder_errors() -> None:
    """Joints that give way, pads, ripple, noise: none of it is fed back into a hum."""
    made = bench("hardware", seed=2)
    start, fastest = made.plant.q.copy(), 0.0
    for _ in range(500):
        made.robot.cycle(None)
        fastest = max(fastest, float(np.abs(made.robot.state.fields["dq"]).max()))
    assert fastest < 0.02
    assert np.abs(made.plant.q - start).max() < 5e-4
