"""What hung on a six-axis sensor, from recordings of its wrench and pose, simulated by MuJoCo's own sensors."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import palpate as pp
from palpate.common.errors import InputError
from palpate.estimation.logs.reading import read_recording
from palpate.estimation.logs.wrench_log import WrenchLog
from palpate.robots.owner import load_description
from palpate.trace.recording import ArmLog

MASS, COM, INERTIA = 0.4, (0.01, -0.006, 0.03), (2e-3, 1.5e-3, 1e-3, 0.0, 0.0, 0.0)
TOOL = (0.9, (0.0, 0.002, 0.05), (2e-3, 2e-3, 1e-3, 0.0, 0.0, 0.0))
ZERO = (3.0, -2.0, 8.0, 0.1, 0.2, -0.05)
RATE, WINDOW = 100, (8.0, 18.0)
Log = dict[str, np.ndarray]
QUATERNION = [f"pose.orientation.{letter}" for letter in "xyzw"]


def sensed(bodies: list[tuple[Any, ...]], turn: Rotation, place: np.ndarray) -> np.ndarray:
    """Wrench (n, 6) that a sensor exerts on bodies fixed to it, by MuJoCo's force and torque sensors."""
    inner = "".join(
        f'<body><inertial mass="{m}" pos="{" ".join(map(str, c))}" fullinertia="{" ".join(map(str, i))}"/></body>'
        for m, c, i in bodies
    )
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><freejoint/><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/><body>'
        '<inertial mass="1e-9" pos="0 0 0" diaginertia="1e-12 1e-12 1e-12"/><site name="s"/>'
        f'{inner}</body></body></worldbody><sensor><force site="s"/><torque site="s"/></sensor></mujoco>'
    )
    data, step = mujoco.MjData(model), 1.0 / RATE
    velocity = np.gradient(place, step, axis=0)
    spin = (turn[:-1].inv() * turn[1:]).as_rotvec() / step
    spin = (np.vstack([spin[:1], spin]) + np.vstack([spin, spin[-1:]])) / 2.0
    changes = [np.gradient(x, step, axis=0) for x in (velocity, spin)]
    q, found = turn.as_quat()[:, [3, 0, 1, 2]], np.empty((len(place), 6))
    for i in range(len(place)):
        data.qpos[:3], data.qpos[3:] = place[i], q[i]
        data.qvel[:3], data.qvel[3:] = velocity[i], spin[i]
        data.qacc[:3], data.qacc[3:] = changes[0][i], changes[1][i]
        mujoco.mj_inverse(model, data)
        found[i] = data.sensordata
    return found


def quaternions(turn: Rotation) -> Log:
    return dict(zip(QUATERNION, turn.as_quat().T, strict=True))


@cache
def record(tool: bool = False, still: bool = False, seed: int = 0) -> Log:
    """20 s at 100 Hz: what acts on the sensor, with a load all the time, or below a tool in a window."""
    random, t = np.random.default_rng(seed), np.arange(20 * RATE) / RATE
    phase, speed = random.uniform(0, 6.28, (6, 3)), random.uniform(0.05, 0.35, (6, 3))
    waves = np.sin(2 * np.pi * speed[:, :, None] * t * (not still) + phase[:, :, None])
    waves = np.einsum("s,ast->ta", [0.6, 0.4, 0.2], waves)
    turn = Rotation.from_euler("xyz", waves[:, :3]) * Rotation.from_rotvec([np.pi, 0.0, 0.0])
    load, below = (MASS, COM, INERTIA), [TOOL] if tool else []
    wrench = sensed([*below, load], turn, 0.1 * waves[:, 3:])
    if tool:
        held = (t > WINDOW[0]) & (t < WINDOW[1])
        wrench = np.where(held[:, None], wrench, sensed(below, turn, 0.1 * waves[:, 3:]))
    noise = random.normal(size=wrench.shape) * np.repeat([0.05, 0.002], 3)
    drift = np.cumsum(random.normal(size=wrench.shape), axis=0) * np.repeat([2e-3, 6e-5], 3)
    place = dict(zip((f"pose.position.{x}" for x in "xyz"), 0.1 * waves[:, 3:].T, strict=True))
    return {"t": t, "wrench": -(wrench + noise + drift + ZERO), **quaternions(turn), **place}


def estimate(folder: Path, log: Log, columns: str = "", **options: Any) -> pp.Run:
    file, names = folder / "log.npz", folder / "map.yaml"
    np.savez(file, **log)
    names.write_text(columns or "{}")
    return pp.estimate(file, columns=names, **options)


def turn_of(log: Log) -> Rotation:
    return Rotation.from_quat(np.column_stack([log[name] for name in QUATERNION]))


def in_axes(log: Log, turn: Rotation) -> Log:
    """The wrench in axes that are turned."""
    force, torque = np.split(log["wrench"], 2, axis=1)
    return log | {"wrench": np.hstack([turn.apply(force), turn.apply(torque)])}


def inside(estimate: pp.Estimate, truth: Any, most: float = 3.0) -> bool:
    return bool((np.abs(estimate.z_score(truth)) < most).all())


def test_mass_centre_and_inertia_need_no_arm(tmp_path: Path) -> None:
    run = estimate(tmp_path, record())
    mass, com, inertia = (run[f"load.{name}"] for name in ("mass", "com", "inertia"))
    assert run.status == "complete"
    assert (mass.identified, com.identified, inertia.identified) == (True, True, True)
    assert inside(mass, MASS)
    assert inside(com, COM)
    assert inside(inertia, INERTIA)
    # The stated gain of 1 % is most of the interval of the mass, and other runs share it.
    assert 0.003 < mass.stds[0] < 0.006
    assert "gain of the wrench sensor" in {one.cause for one in mass.shared}
    assert (com.stds < 2e-3).all()
    assert "the axes of the sensor, from its origin" in com.method


def test_a_better_gain_narrows_the_mass(tmp_path: Path) -> None:
    exact = estimate(tmp_path, record(), "gain: 0.001")["load.mass"]
    assert inside(exact, MASS)
    assert exact.stds[0] < 0.0015


def test_a_load_in_a_window_below_a_tool(tmp_path: Path) -> None:
    run = estimate(tmp_path, record(tool=True), loaded=WINDOW, hand="found")
    assert inside(run["load.mass"], MASS)
    assert inside(run["load.com"], COM)
    assert inside(run["hand.mass"], TOOL[0])
    assert run.status == "complete"


def test_the_empty_hand_may_be_another_recording(tmp_path: Path) -> None:
    """Each has its own zero."""
    log = record(tool=True)
    held = (log["t"] > WINDOW[0] + 0.2) & (log["t"] < WINDOW[1] - 0.2)
    empty = tmp_path / "empty.npz"
    alone = {name: values[log["t"] < WINDOW[0] - 0.2] for name, values in log.items()}
    np.savez(empty, **(alone | {"wrench": alone["wrench"] + 5.0}))
    run = estimate(tmp_path, {name: x[held] for name, x in log.items()}, empty=empty)
    assert inside(run["load.mass"], MASS)
    assert run["load.mass"].identified


def test_intervals_hold_over_seeds(tmp_path: Path) -> None:
    found = [estimate(tmp_path, record(seed=seed)) for seed in range(4)]
    for name, truth in (("mass", MASS), ("com", COM), ("inertia", INERTIA)):
        z = np.concatenate([np.atleast_1d(run[f"load.{name}"].z_score(truth)) for run in found])
        assert np.sqrt(np.mean(z**2)) < 1.5
        assert np.abs(z).max() < 3.5


@pytest.mark.parametrize(
    ("change", "says", "mended"),
    [
        ("sign", "opposite sign", "sign: by_sensor"),
        ("world", "state 'frame: world'", "frame: world"),
        ("mount", "turned by 45° against the logged pose", "sensor: [0, 0, 0, 0.92388, 0, 0, 0.38268]"),
        ("inverse", "log their inverse", ""),
        ("unit", "another unit than N m", ""),
        ("milli", "would weigh [34].. kg: the wrench is in another unit", ""),
        ("contact", "something touched the load", ""),
    ],
)  # fmt: skip
def test_a_wrench_that_is_not_as_stated_is_contradicted(
    tmp_path: Path, change: str, says: str, mended: str
) -> None:
    log, turn = record(), turn_of(record())
    pushed = np.zeros_like(log["wrench"])
    pushed[600:900, :3] = turn[600:900].inv().apply([2.0, 1.0, 3.0])
    wrong = {
        "sign": lambda: log | {"wrench": -log["wrench"]},
        "world": lambda: in_axes(log, turn),
        "mount": lambda: in_axes(log, Rotation.from_euler("z", -45, degrees=True)),
        "inverse": lambda: log | quaternions(turn.inv()),
        "unit": lambda: log | {"wrench": log["wrench"] * [1, 1, 1, 1e3, 1e3, 1e3]},
        "milli": lambda: log | {"wrench": log["wrench"] * 1e3},
        "contact": lambda: log | {"wrench": log["wrench"] + pushed},
    }[change]()
    if change == "world":
        wrong["wrench"] = in_axes(log | {"wrench": log["wrench"] + ZERO}, turn)["wrench"]
    run = estimate(tmp_path, wrong)
    mass = run["load.mass"]
    assert mass.verdict == "contradicted"
    assert re.search(says, mass.contradiction)
    assert run["load.com"].verdict == "not identified"
    if mended:
        found = estimate(tmp_path, wrong, mended)["load.mass"]
        assert found.identified
        assert inside(found, MASS)


def test_a_sensor_zeroed_with_the_load_in_hand_is_contradicted(tmp_path: Path) -> None:
    log = record(tool=True)
    held = log["t"] > WINDOW[0]
    wrench = log["wrench"].copy()
    wrench[held] -= wrench[np.flatnonzero(held)[5]]
    mass = estimate(tmp_path, log | {"wrench": wrench}, loaded=WINDOW)["load.mass"]
    assert mass.verdict == "contradicted"
    assert "zeroed with the load in the hand" in mass.contradiction


def test_a_single_pose_does_not_separate_weight_and_zero(tmp_path: Path) -> None:
    run = estimate(tmp_path, record(still=True))
    assert [one.verdict for one in run.estimates] == ["not identified"] * 3
    assert "gravity turns by 0° only. Hold the load in three" in run["load.mass"].method


def test_single_poses_at_rest_with_an_axis_that_drifts(tmp_path: Path) -> None:
    """A row a pose, four seconds apart. An axis with drift counts less than the others."""
    random = np.random.default_rng(2)
    turn = Rotation.from_rotvec(random.normal(size=(60, 3)) * 0.5)
    force = np.einsum("kji,j->ki", turn.as_matrix(), [0.0, 0.0, 9.81 * MASS])
    wrench = np.hstack([force, np.cross(COM, force)])
    wrench += random.normal(size=wrench.shape) * np.repeat([0.02, 0.001], 3)
    wrench[:, 2] += np.linspace(0.0, 1.5, 60)
    run = estimate(tmp_path, {"t": 4.0 * np.arange(60), "ft": -wrench - ZERO, **quaternions(turn)})
    assert inside(run["load.mass"], MASS)
    assert run["load.mass"].identified
    assert run["load.mass"].stds[0] < 0.008
    assert inside(run["load.com"], COM)
    assert run["load.inertia"].verdict == "prior-dominated"


@pytest.mark.parametrize("poses", [2, 10])
def test_rests_without_the_ways_between_them_are_no_motion(tmp_path: Path, poses: int) -> None:
    """Two seconds at each pose, cut together: the jumps of the pose say nothing about a rotation."""
    random, rows = np.random.default_rng(3), 2 * RATE
    turn = Rotation.from_euler("xyz", random.uniform(-1.2, 1.2, (poses, 3)))
    turn = Rotation.from_quat(np.repeat(turn.as_quat(), rows, axis=0))
    force = np.einsum("kji,j->ki", turn.as_matrix(), [0.0, 0.0, 9.81 * MASS])
    wrench = np.hstack([force, np.cross(COM, force)])
    wrench += random.normal(size=wrench.shape) * np.repeat([0.1, 0.005], 3)
    log = {"t": np.arange(poses * rows) / RATE, "ft": -wrench - ZERO, **quaternions(turn)}
    run = estimate(tmp_path, log)
    assert inside(run["load.mass"], MASS)
    assert inside(run["load.com"], COM)
    # Two directions of gravity leave one direction of the lever open.
    assert run["load.com"].verdict == ("identified" if poses > 2 else "prior-dominated")
    assert run["load.inertia"].verdict == "prior-dominated"


def test_mass_and_centre_need_no_positions(tmp_path: Path) -> None:
    log = {name: values for name, values in record().items() if "position" not in name}
    run = estimate(tmp_path, log)
    assert inside(run["load.mass"], MASS)
    assert inside(run["load.com"], COM)


def test_a_saturated_and_a_dead_column_are_named(tmp_path: Path) -> None:
    wrench = record()["wrench"].copy()
    wrench[:, 1] = np.minimum(wrench[:, 1], np.quantile(wrench[:, 1], 0.93))
    with pytest.raises(InputError, match=r"column 'wrench\[1\]' is saturated: it stays at .* for"):
        estimate(tmp_path, record() | {"wrench": wrench})
    wrench[:, 1] = 0.25
    with pytest.raises(InputError, match=r"'wrench\[1\]' stays at 0.25: its sensor is dead"):
        estimate(tmp_path, record() | {"wrench": wrench})


def test_a_log_of_a_six_axis_arm_is_read(tmp_path: Path) -> None:
    """UR's names in a CSV: angles of six joints, the raw wrench, and a pose with a rotation vector."""
    log, file = record(), tmp_path / "ur.csv"
    pose = np.column_stack([np.zeros((len(log["t"]), 3)), turn_of(log).as_rotvec()])
    parts = {"ft_raw_wrench": log["wrench"], "actual_TCP_force": log["wrench"] * 0.1}
    parts |= {"actual_TCP_pose": pose, "target_TCP_pose": 0 * pose, "actual_q": 0 * pose}
    names = [f"{name}_{i}" for name in parts for i in range(6)]
    rows = np.column_stack([log["t"], *parts.values()])
    text = ",".join(["timestamp", *names])
    np.savetxt(file, rows, delimiter=",", header=text, comments="")
    run = pp.estimate(file)
    assert inside(run["load.mass"], MASS)
    assert "the wrench is ft_raw_wrench_0 … ft_raw_wrench_5" in run.plan.notes[0]
    assert "the pose actual_TCP_pose_0 … actual_TCP_pose_5" in run.plan.notes[0]
    # What the controller has subtracted is told of, and there is one choice.
    (tmp_path / "map.yaml").write_text("wrench: actual_TCP_force\n")
    log_of_force = read_recording(file, tmp_path / "map.yaml")
    assert isinstance(log_of_force, WrenchLog)
    assert any("subtracted a payload" in note for note in log_of_force.notes)


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_names_with_units_and_angles_of_roll_pitch_and_yaw(tmp_path: Path, unit: str) -> None:
    log, file = record(), tmp_path / "angles.csv"
    angles = turn_of(log).as_euler("xyz", degrees=unit == "deg")
    names = [f"F_{x}(N)" for x in "xyz"] + [f"T_{x}(Nm)" for x in "xyz"]
    names += ["roll", "pitch", "yaw", "P_x(m)", "P_y(m)", "P_z(m)"]
    place = np.column_stack([log[f"pose.position.{x}"] for x in "xyz"])
    rows = np.column_stack([log["t"], log["wrench"], angles, place])
    np.savetxt(file, rows, delimiter=",", header=",".join(["Time(s)", *names]), comments="")
    run = pp.estimate(file)
    assert inside(run["load.mass"], MASS)
    assert inside(run["load.com"], COM)


def test_topics_of_a_bag_have_their_own_clocks(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    log, store = record(), get_typestore(Stores.ROS2_HUMBLE)
    types = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
    wrench, pose = "geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/PoseStamped"
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        sensor = writer.add_connection("/ft_sensor/wrench", wrench, typestore=store)
        place = writer.add_connection("/flange", pose, typestore=store)

        def write(connection: Any, t: float, content: Any) -> None:
            of = types["Header"](types["Time"](int(t), round(t % 1 * 1e9)), "frame")
            kind = connection.msgtype
            message = store.types[kind](of, content)
            writer.write(connection, round(t * 1e9), store.serialize_cdr(message, kind))

        for i, t in enumerate((log["t"] + 1.76e9).tolist()):
            force, torque = (types["Vector3"](*part) for part in np.split(log["wrench"][i], 2))
            write(sensor, t, types["Wrench"](force, torque))
            if i % 2 == 0:  # poses at half the rate, and at other times
                position = types["Point"](*(log[f"pose.position.{x}"][i] for x in "xyz"))
                turned = types["Quaternion"](*(log[name][i] for name in QUATERNION))
                write(place, t + 1e-4, types["Pose"](position, turned))
    run = pp.estimate(tmp_path / "bag")
    assert inside(run["load.mass"], MASS)
    assert inside(run["load.com"], COM)
    assert "/ft_sensor/wrench" in run.plan.notes[0]


def test_joint_angles_with_an_arm_are_poses(tmp_path: Path) -> None:
    """A sensor at the TCP of an FR3 whose angles are logged."""
    log, arm = record(), load_description("fr3")
    q = arm.home + 0.5 * np.sin(np.outer(log["t"], np.arange(1, 8)) * 0.3 + np.arange(7))
    from palpate.common.pose import Pose
    from palpate.robots.nominal import NominalArm

    pose = NominalArm(arm, Pose.of((0, 0, 0)), np.zeros(3)).poses(q)
    turn = Rotation.from_quat(pose[:, [4, 5, 6, 3]])
    force = -sensed([(MASS, COM, INERTIA)], turn, pose[:, :3])
    random = np.random.default_rng(0)
    noisy = force + random.normal(size=force.shape) * np.repeat([0.05, 0.002], 3)
    run = estimate(tmp_path, {"t": log["t"], "q": q, "ft": noisy})
    assert inside(run["load.mass"], MASS)
    assert inside(run["load.com"], COM)
    assert "that of the TCP of 'fr3' by q[0]" in run.plan.notes[0]


def test_missing_signals_of_a_log_are_named(tmp_path: Path) -> None:
    log = record()
    with pytest.raises(
        InputError, match=r"has no orientation beside it\. Log the sensor's quaternion"
    ):
        estimate(tmp_path, {"t": log["t"], "wrench": log["wrench"]})
    twice = {
        f"{name}_{part}": log["wrench"][:, i] + k
        for k, name in enumerate("ab")
        for i, part in enumerate(("fx", "fy", "fz", "tx", "ty", "tz"))
    }
    with pytest.raises(
        InputError, match="several columns of a wrench; found: a_fx … a_tz, b_fx … b"
    ):
        estimate(tmp_path, {"t": log["t"], **twice, **{n: log[n] for n in QUATERNION}})
    with pytest.raises(InputError, match="no wrench 'ftt'; found: wrench"):
        estimate(tmp_path, log, "wrench: ftt")
    with pytest.raises(InputError, match="no column for time"):
        estimate(tmp_path, {name: x for name, x in log.items() if name != "t"})
    with pytest.raises(InputError, match="no unit quaternions"):
        estimate(tmp_path, log | {QUATERNION[0]: log[QUATERNION[0]] + 3.0})
    with pytest.raises(InputError, match="a sensor sees all that is mounted below it"):
        estimate(tmp_path, log, hand=0.5)


def test_joint_torques_are_preferred_and_the_wrench_is_mentioned(tmp_path: Path) -> None:
    log, file = record(), tmp_path / "both.npz"
    q = np.sin(np.outer(log["t"], np.ones(7)) + np.arange(7))
    np.savez(file, **log, q=q, tau=np.cos(q))
    found = read_recording(file)
    assert isinstance(found, ArmLog)
    assert "its wrench is not read: state it in a file with 'wrench: NAME' to use it" in found.notes
    (tmp_path / "map.yaml").write_text("wrench: wrench\n")
    assert isinstance(read_recording(file, tmp_path / "map.yaml"), WrenchLog)


def test_a_run_folder_keeps_the_wrench(tmp_path: Path) -> None:
    run = estimate(tmp_path, record())
    saved = run.save(tmp_path / "run")
    again = pp.open(tmp_path / "run").estimate()
    assert again["load.mass"].values[0] == pytest.approx(run["load.mass"].values[0], rel=1e-9)
    assert json.loads((tmp_path / "run" / "result.json").read_text())["status"] == "complete"
    assert saved.shortfalls == ()
    np.testing.assert_array_equal(
        pp.open(tmp_path / "run").trace.samples.wrench_sensor, run.trace.samples.wrench_sensor
    )
