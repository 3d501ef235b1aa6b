"""Joint signals of one arm among the columns of a log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.common.errors import InputError
from palpate.estimation.logs.reading import read_log
from palpate.trace.recording import ArmLog

N = 200
T = np.arange(N) * 2e-3
PHASE = np.arange(7)
Q = 0.4 * np.sin(2 * T[:, None] + PHASE)
DQ = 0.8 * np.cos(2 * T[:, None] + PHASE)
TAU = 10 * np.cos(T[:, None] + PHASE)
LEFT, RIGHT = (Q, DQ, TAU), (-Q, -DQ, 1 - TAU)
Columns = dict[str, np.ndarray]


def joints(form: str, values: np.ndarray, first: int = 1) -> Columns:
    """Columns of joints by their numbers."""
    return {form.format(first + i): part for i, part in enumerate(values.T)}


def arm(q: str, dq: str, tau: str, arm: tuple[np.ndarray, ...]) -> Columns:
    return joints(q, arm[0]) | joints(dq, arm[1]) | joints(tau, arm[2])


def read(tmp_path: Path, columns: Columns, text: str = "") -> ArmLog:
    """Write a CSV with these columns, or an archive of wide ones, and read it with a map."""
    table, mapped = {"t": T} | columns, tmp_path / "map.yaml"
    mapped.write_text(text or "{}")
    if any(values.ndim == 2 for values in columns.values()):
        np.savez(tmp_path / "log.npz", **table)
        return read_log(tmp_path / "log.npz", mapped)
    header = ",".join(table)
    rows = np.column_stack(list(table.values()))
    np.savetxt(tmp_path / "log.csv", rows, "%.17g", ",", header=header, comments="")
    return read_log(tmp_path / "log.csv", mapped)


def is_arm(log: ArmLog, wanted: tuple[np.ndarray, ...], dq: float = 1e-9) -> bool:
    """The log holds this arm's signals, velocities to `dq` rad/s."""
    q, rates, tau = wanted
    return (
        np.allclose(log.q, q) and np.allclose(log.tau, tau) and np.allclose(log.dq, rates, atol=dq)
    )


KINDS = "position", "velocity", "effort"
TWO_ARMS = {
    "a side": tuple(f"{{}}_fr3_joint{{{{}}}}/{kind}" for kind in KINDS),
    "a number": ("{}_q{{}}", "{}_dq{{}}", "{}_tau_J{{}}"),
    "a suffix": tuple(f"yumi_joint_{{{{}}}}_{{}}.{kind}" for kind in KINDS),
    "a topic": tuple(f"/{{}}/joint_states/joint{{{{}}}}/{kind}" for kind in KINDS),
}


@pytest.mark.parametrize(
    ("forms", "one", "other"),
    [
        ("a side", "left", "right"),
        ("a number", "robot1", "robot2"),
        ("a number", "panda", "fr3"),
        ("a number", "arm_1", "arm_2"),
        ("a suffix", "l", "r"),
        ("a topic", "leader", "follower"),
    ],
)
def test_two_arms_are_not_mixed(tmp_path: Path, forms: str, one: str, other: str) -> None:
    first, second = (tuple(form.format(name) for form in TWO_ARMS[forms]) for name in (one, other))
    columns = arm(*first, LEFT) | arm(*second, RIGHT)
    with pytest.raises(InputError, match=rf"joints of several arms: '\w*{one}\w*' .*'\w*{other}"):
        read(tmp_path, columns)
    for name, wanted in ((one, LEFT), (other, RIGHT)):
        assert is_arm(read(tmp_path, columns, f"joints: {name}\n"), wanted)
    with pytest.raises(InputError, match=f"joints of several arms.*{other}"):
        read(tmp_path, columns, "joints: middle\n")


def test_the_arm_without_a_name_is_chosen_too(tmp_path: Path) -> None:
    columns = arm("q{}", "dq{}", "tau{}", LEFT) | arm(
        "right_q{}", "right_dq{}", "right_tau{}", RIGHT
    )
    with pytest.raises(InputError, match=r"'' \(q1 …\), 'right'.* with 'joints: right'"):
        read(tmp_path, columns)
    assert is_arm(read(tmp_path, columns, "joints: ''\n"), LEFT)


def test_columns_of_two_topics_of_one_arm_need_no_choice(tmp_path: Path) -> None:
    columns: Columns = {}
    for topic, shift in (("/states", 0.0), ("/controller/states", 0.0), ("/states_desired", 1.0)):
        forms = (f"{topic}/panda_joint{{}}/{kind}" for kind in ("position", "velocity", "effort"))
        columns |= arm(*forms, (Q + shift, DQ, TAU + shift))
    assert is_arm(read(tmp_path, columns), LEFT)


def test_other_joints_are_left_out_and_named(tmp_path: Path) -> None:
    others = {
        f"{name}/{kind}": np.full(N, 0.1)
        for name in ("head_1_joint", "head_2_joint", "torso_lift_joint", "gripper_finger_joint1")
        for kind in ("position", "velocity", "effort")
    }
    forms = ("arm_{}_joint/position", "arm_{}_joint/velocity", "arm_{}_joint/effort")
    log = read(tmp_path, others | arm(*forms, LEFT))
    assert is_arm(log, LEFT)
    (note,) = log.notes
    assert note.startswith(
        "joints arm_1_joint/position to arm_7_joint/position are read, not head_1"
    )
    assert "gripper_finger_joint1" in note


def test_joint_numbers_are_not_read_as_words(tmp_path: Path) -> None:
    """Fourteen joints in the order of words, joint10 before joint2, are two arms."""
    both = [np.hstack(parts) for parts in zip(LEFT, RIGHT, strict=True)]
    columns = dict(sorted(arm("joint{}_pos", "joint{}_vel", "joint{}_torque", tuple(both)).items()))
    with pytest.raises(InputError, match=r"'1-7' \(joint1_pos …\), '8-14' \(joint8_pos …\)"):
        read(tmp_path, columns)
    assert is_arm(read(tmp_path, columns, "joints: 1-7\n"), LEFT)
    assert is_arm(read(tmp_path, columns, "joints: 8-14\n"), RIGHT)


def test_surplus_columns_are_left_out_and_named(tmp_path: Path) -> None:
    fingers = np.full((N, 2), 0.04)
    log = read(
        tmp_path,
        {
            name: np.hstack([part, fingers])
            for name, part in zip(("q", "dq", "tau"), LEFT, strict=True)
        },
    )
    assert is_arm(log, LEFT)
    assert log.notes == ("joints q[0] to q[6] are read, not q[7], q[8]",)
    for finger in (fingers[:, :0], fingers[:, :1]):
        parts = (np.hstack([a, finger, b, finger]) for a, b in zip(LEFT, RIGHT, strict=True))
        columns = dict(zip(("q", "dq", "tau"), parts, strict=True))
        start = 7 + finger.shape[1]
        with pytest.raises(InputError, match=rf"'0-6' \(q\[0\] …\), '{start}-{start + 6}'"):
            read(tmp_path, columns)
        assert is_arm(read(tmp_path, columns, f"joints: {start}-{start + 6}\n"), RIGHT)


def test_a_slice_counts_columns_in_the_order_of_the_file(tmp_path: Path) -> None:
    names = [
        f"position.{name}" for name in ("b_2", "b_1", "a_9", "c_1", "c_10", "c_2", "d_1", "d_2")
    ]
    columns = dict(zip(names[1:], Q.T, strict=True)) | {"u": TAU}
    log = read(tmp_path, {names[0]: Q[:, 0] + 1} | columns, "q: position[1:8]\ntau: u\n")
    assert is_arm(log, LEFT, dq=0.1)


def test_a_map_of_one_signal_does_not_mix_arms(tmp_path: Path) -> None:
    """The right arm's positions with the left arm's torques or velocities would be neither's."""
    columns = {
        name: np.hstack(parts)
        for name, parts in zip(("q", "dq", "tau"), zip(LEFT, RIGHT, strict=True), strict=True)
    }
    with pytest.raises(InputError, match=r"no column for joint torques with gravity \(tau\)"):
        read(tmp_path, columns, "q: q[7:14]\n")
    log = read(tmp_path, columns, "q: q[7:14]\ntau: tau[7:14]\n")
    assert is_arm(log, RIGHT, dq=0.1)
    assert log.notes == ("joint velocities are not logged: taken from the positions",)
    with pytest.raises(InputError, match=r"q: q has 14 numbers, not 7; give .* 'q: NAME\[0:7\]'"):
        read(tmp_path, columns, "q: q\n")


def test_measured_signals_are_preferred(tmp_path: Path) -> None:
    columns = joints("tau_{}", TAU + 1) | joints("theta_{}", Q + 1) | joints("tau_measured_{}", TAU)
    columns |= joints("q_{}", Q) | joints("dq_{}", DQ) | joints("q_des_{}", Q + 1)
    log = read(tmp_path, columns | joints("cartesian_position_{}", Q + 1))
    assert is_arm(log, LEFT)


def test_an_arm_with_six_joints(tmp_path: Path) -> None:
    columns = {"actual_q": Q[:, :6], "actual_torque": TAU[:, :6]}
    with pytest.raises(InputError, match=r"no column for joint positions .* An arm has 7 joints"):
        read(tmp_path, columns)


def test_columns_of_unequal_length_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"columns of unequal length: \{.*'t': 200"):
        read(tmp_path, {"q": Q[1:], "tau": TAU})
    with pytest.raises(InputError, match="columns of unequal length"):
        read(tmp_path, {"q": Q.T, "tau": TAU.T})


def test_an_unknown_word_in_the_names_is_reported(tmp_path: Path) -> None:
    log = read(tmp_path, {"motor_q": Q, "motor_dq": DQ, "motor_torque": TAU})
    assert is_arm(log, LEFT)
    assert log.notes == ("the columns are those of 'motor', as motor_q[0]",)
