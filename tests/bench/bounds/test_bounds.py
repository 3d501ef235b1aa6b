"""Bounds: on one recording, with noise models whose bound can be worked out by hand, or must grow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.bounds.blocks import BLOCK, Blocks, Column, blocks, covariance
from bench.bounds.bound import bounds_of
from bench.bounds.heights import of_height
from bench.bounds.loads import of_load
from palpate.common.parameter import Parameter
from palpate.robots.simulated.noise.model import NoiseModel, Torque
from palpate.robots.simulated.timing import BLOCK as CYCLES
from palpate.runs import pipeline
from palpate.runs.run import Run
from palpate.runs.settings import Settings

SCENE = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="table" pos="0.4 0 {table}"><geom type="box" size=".5 .6 .02" friction="0.6 0.005 0.0001"/></body>
  <body name="cup" pos="0.5 0.1 0.05"><freejoint/>
    <geom type="box" size=".03 .02 .05" friction="0.5"{mass}/></body>
</worldbody></mujoco>"""
MASS = 0.3


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A cup that was weighed on a table that was touched, without any noise."""
    folder = tmp_path_factory.mktemp("bounds")
    for name, filled in {
        "scene": {"table": "?", "mass": ""},
        "world": {"table": "-0.02", "mass": f' mass="{MASS}"'},
    }.items():
        (folder / f"{name}.xml").write_text(SCENE.format(**filled), encoding="utf-8")
    settings = Settings(scene=folder / "scene.xml", world=folder / "world.xml", noise="none")
    return pipeline.measure(pipeline.plan(settings, pipeline.load(settings)))


def mass_and_com(run: Run, **noise: object) -> tuple[float, np.ndarray]:
    model = NoiseModel.model_validate(noise)
    found = of_load(run.trace, "cup", np.eye(3), MASS, run.scene.arm, model)
    assert found is not None
    return found


def mass(run: Run, **noise: object) -> float:
    return mass_and_com(run, **noise)[0]


def height(run: Run, **noise: object) -> float:
    model = NoiseModel.model_validate(noise)
    table = Parameter("table", "height")
    found = of_height(run.trace, table, run.scene.pose_world_base, run.scene.arm, model)
    assert found is not None
    return found


def still(count: int, rows: float = 20.0) -> Blocks:
    """An arm that stands, each block of so many rows."""
    zeros = np.zeros((count, 7))
    return Blocks(
        np.repeat(np.arange(count), int(rows)),
        np.full(count, rows),
        BLOCK * np.arange(count),
        zeros,
        zeros,
        zeros[:, :3],
        np.broadcast_to(np.eye(3), (count, 3, 3)),
        zeros[:, :3],
        np.zeros((count, 7, 6)),
        np.eye(3),
    )


def constant(count: int, size: float) -> Column:
    """The same torque in joint 2 all the time."""
    torque = np.zeros((count, 7))
    torque[:, 1] = 1.0
    return Column(torque, size)


def test_white_noise_leaves_the_error_of_the_mean_of_all_samples() -> None:
    count, white = 50, 0.1
    (variance,) = covariance(
        [constant(count, 1e3)],
        [],
        still(count),
        np.ones(count, dtype=bool),
        Torque.model_validate({"white": white}),
    ).ravel()
    assert np.sqrt(variance) == pytest.approx(white / np.sqrt(count * 20 * CYCLES), rel=1e-4)


def test_a_drift_is_not_averaged_away() -> None:
    """The best of an Ornstein-Uhlenbeck process that is watched for T time constants has the
    variance 2 size² / (2 + T) (U. Grenander, Arkiv för Matematik 1 (1950), section 4)."""
    count, size, time = 600, 0.01, 10.0
    noise = Torque.model_validate({"drift": {"size": size, "time_constant": time}})
    counted = np.ones(count, dtype=bool)
    (variance,) = covariance([constant(count, 1e3)], [], still(count), counted, noise).ravel()
    watched = count * BLOCK / time
    assert np.sqrt(variance) == pytest.approx(size * np.sqrt(2 / (2 + watched)), rel=0.02)


def test_unobservable_quantities_keep_their_prior_uncertainty() -> None:
    """Two unknowns that do the same: each is known from the other's size."""
    count = 50
    noise = Torque.model_validate({"white": 1e-4})
    found = covariance(
        [constant(count, 3.0)],
        [constant(count, 4.0)],
        still(count),
        np.ones(count, dtype=bool),
        noise,
    )
    assert np.sqrt(found[0, 0]) == pytest.approx(3 * 4 / 5, rel=1e-3)


def test_the_bound_of_a_mass_is_in_proportion_to_white_noise(run: Run) -> None:
    one = mass(run, torque={"white": 0.1})
    assert one == pytest.approx(mass(run, torque={"white": 0.2}) / 2, rel=1e-3)
    assert 1e-4 < one < 2e-3


def test_a_gain_sets_a_floor_in_proportion_to_the_load(run: Run) -> None:
    """Whatever the joints: no farther off than all gains together, no nearer than seven that
    average out."""
    floor = mass(run, torque={"white": 1e-4, "gain_max": 0.01})
    of_one_joint = MASS * 0.01 / np.sqrt(3.0)
    assert of_one_joint / np.sqrt(7.0) < floor < 1.05 * of_one_joint


@pytest.mark.parametrize(
    "more",
    [
        {"torque": {"white": 0.1, "flicker": {"level": 0.02}}},
        {"torque": {"white": 0.1, "drift": {"size": 0.05, "time_constant": 20}}},
        {"friction": {"coulomb": 0.3}},
        {"friction": {"viscous": 0.5}},
        {"friction": {"coulomb": 0.3, "position": 0.2}},
        {"friction": {"load": 0.01}},
        {"torque": {"white": 0.1, "crosstalk": 0.01}},
        {"torque": {"white": 0.1, "ripple": {"size": 0.1}}},
        {"sticking": {"force": 0.3}},
        {"sticking": {"torque": 0.05, "memory": 0.5, "relaxation": 60}},
        {"model": {"payload_cable": 0.3}},
        {"model": {"base_tilt": 0.01}},
        {"model": {"gravity": 0.5}},
    ],
)
def test_every_error_of_the_arm_raises_the_bound(
    run: Run, more: dict[str, dict[str, float]]
) -> None:
    white = {"torque": {"white": 0.1}}
    assert mass(run, **(white | more)) > 1.0001 * mass(run, **white)


def test_a_hanging_hand_does_not_determine_a_centre_straight_below(run: Run) -> None:
    _, com = mass_and_com(run, torque={"white": 0.1})
    assert com[:2].max() < 0.005
    assert com[2] > 0.1


def test_a_sideways_position_is_determined_along_the_closing_direction_only(run: Run) -> None:
    model = NoiseModel.model_validate({"torque": {"white": 0.1}})
    stands, aside = (
        of_load(run.trace, "cup", np.eye(3), MASS, run.scene.arm, model, place)
        for place in (0.0, 0.01)
    )
    assert stands is not None
    assert aside is not None
    assert aside[0] == stands[0]
    grown = np.sqrt(aside[1] ** 2 - stands[1] ** 2)
    assert np.sort(grown[:2]) == pytest.approx([0.0, 0.01], abs=1e-3)
    assert grown[2] == 0.0


def test_a_height_is_known_as_well_as_the_fingertips_and_the_frame(run: Run) -> None:
    tip = height(run, model={"tip_offset": 2e-4})
    assert tip == pytest.approx(2e-4, rel=1e-4)
    base = {"tip_offset": 2e-4, "base_position": 1.5e-4}
    assert height(run, model=base, pose={"repeatability": 1e-4}) == pytest.approx(
        np.linalg.norm([2e-4, 1.5e-4, 1e-4]), rel=1e-4
    )
    fixed = {"tip_offset": {"fixed": 2e-4}, "base_position": 1.5e-4}
    assert height(run, model=fixed) == pytest.approx(1.5e-4, rel=1e-4)


def test_encoders_and_links_raise_the_fingertips_by_their_levers(run: Run) -> None:
    offset = height(run, model={"joint_offset": 1e-3})
    assert 3e-4 < offset < 1.5e-3  # 0.3 to 0.7 m of lever, two or three joints that count
    assert height(run, model={"link_length": 3e-4}) < 3e-4 * np.sqrt(7)


def test_a_run_has_bounds_by_quantity(run: Run) -> None:
    found = {str(each.parameter): bounds_of(run, each) for each in run.estimates}
    assert set(found) == {"cup.mass", "table.height"}
    assert found["table.height"] == (0.0,)  # a perfect arm
    other = replace(run.estimates[0], parameter=Parameter("table", "stiffness"))
    assert bounds_of(run, other) is None
    assert bounds_of(replace(run, simulated=False), run.estimates[0]) is None


def test_a_trace_that_does_not_say_what_torques_mean_has_no_bound(run: Run) -> None:
    told = replace(run.trace, hand=replace(run.trace.hand, chain=None))
    assert blocks(told) is None
    noise = NoiseModel.model_validate({})
    assert of_load(told, "cup", np.eye(3), MASS, run.scene.arm, noise) is None
