"""`palpate estimate LOG`: a recording by another program, as a shell would use it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from palpate.estimation.rigid_bodies import own_motion
from palpate.robots.owner import load_description

from ..estimation.logs.test_wrench import record
from .conftest import Answer

Palpate = Callable[..., Answer]


def motion(folder: Path) -> Path:
    """A few seconds of an arm that hardly moves, with a column map."""
    t = np.arange(1200) / 200
    q = np.array([0.0, -0.8, 0.0, -2.3, 0.0, 1.6, 0.8]) + 0.2 * np.sin(t[:, None] + np.arange(7))
    dq = 0.2 * np.cos(t[:, None] + np.arange(7))
    file = folder / "log.npz"
    np.savez(
        file, time=t, position=q, velocity=dq, moment=np.random.default_rng(0).normal(size=q.shape)
    )
    (folder / "map.yaml").write_text("tau: moment\n")
    return file


def test_a_recording_is_estimated_as_json_and_saved_as_a_folder(
    palpate: Palpate, tmp_path: Path
) -> None:
    log, columns = motion(tmp_path), tmp_path / "map.yaml"
    asked = ("estimate", log, "--loaded", "3-5.9", "--columns", columns, "--hand", "0.7")
    answer = palpate(*asked, "--json", "-o", tmp_path / "run")
    document = json.loads(answer.out)
    assert [row["object"] for row in document["parameters"]] == ["load"] * 3
    assert [row["quantity"] for row in document["parameters"]] == ["mass", "com", "inertia"]
    assert document["simulated"] is False
    assert document["provenance"]["seed"] is None
    assert document["plan"]["planner"] == "recording"
    assert answer.status == (0 if document["status"] == "complete" else 1)
    # Torques of noise alone hold no arm up.
    assert document["parameters"][0]["verdict"] == "contradicted"
    assert "own weight is not in the torques" in str(document["parameters"][0])
    assert (tmp_path / "run" / "report.html").exists()
    again = json.loads(palpate("estimate", tmp_path / "run", "--json").out)
    assert again["parameters"][0]["value"] == document["parameters"][0]["value"]


def test_load_data_are_printed_or_written(palpate: Palpate, tmp_path: Path) -> None:
    log, file = tmp_path / "log.npz", tmp_path / "load.json"
    np.savez(log, **record())
    asked = ("--load-data", "ur", "--load-data", f"franka-desk={file}")
    answer = palpate("estimate", log, *asked)
    assert answer.status == 0
    (line,) = [item for item in answer.out.splitlines() if item.startswith("set_target_payload(")]
    mass = json.loads(file.read_text())["mass"]
    assert line.startswith(f"set_target_payload({mass}, [")
    assert f"load data written to {file}" in " ".join(answer.out.split())
    for options, text in (
        (("--load-data", "abb"), "unknown format of load data 'abb'"),
        (("--load-data", f"ur={file}"), "exists already"),
        (("--load-data", "ur", "--json"), "--load-data ur with --json needs a file"),
    ):
        answer = palpate("estimate", log, "-o", tmp_path / "run", *options)
        assert answer.status == 2
        assert text in " ".join(answer.err.split())
        assert not (tmp_path / "run").exists()


def test_errors_say_what_to_do(palpate: Palpate, tmp_path: Path) -> None:
    log = motion(tmp_path)
    for options, text in (
        ((log,), "no column for joint torques with gravity (tau). Columns: time, position"),
        ((log, "--loaded", "soon"), "--loaded takes seconds A-B, as in 12.0-18.5, not 'soon'"),
        ((log, "--hand", "heavy"), "--hand takes kilograms or 'found'"),
        ((), "give a run folder or a recording, or --how for what to record"),
        ((tmp_path / "none.csv",), "cannot read"),
    ):
        answer = palpate("estimate", *options)
        assert answer.status == 2
        assert text in " ".join(answer.err.split())


def test_an_option_names_one_of_two_arms(palpate: Palpate, tmp_path: Path) -> None:
    with np.load(motion(tmp_path)) as log:
        t, q, dq, tau = (log[name] for name in ("time", "position", "velocity", "moment"))
    arm, still = load_description("fr3"), np.zeros_like(q)
    assert arm.nominal.chain is not None
    tau = tau + own_motion(arm.nominal.chain, q, still, still, np.array([0.0, 0.0, -9.81]))
    columns = {"t": t}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        columns |= {f"{side}_q": sign * q, f"{side}_dq": sign * dq, f"{side}_tau": sign * tau}
    np.savez(tmp_path / "two.npz", **columns)
    asked = ("noise", tmp_path / "two.npz", "--json")
    refused = palpate(*asked)
    assert refused.status == 2
    text = " ".join(refused.err.split())
    assert "several arms: 'left' (left_q[0] …), 'right' (right_q[0] …)" in text
    assert "in a file with 'joints: right', and give it as --columns MAP.yaml" in text
    (tmp_path / "left.yaml").write_text("joints: left\n")
    answer = palpate(*asked, "--columns", tmp_path / "left.yaml")
    assert answer.status == 0
    (note,) = json.loads(answer.out)["notes"]
    assert note.startswith("joints left_q[0] to left_q[6] are read, not right_q[0]")


def test_the_option_how_explains_what_to_record(palpate: Palpate, tmp_path: Path) -> None:
    file = tmp_path / "motion.csv"
    answer = palpate("estimate", "--how", "-o", file)
    assert answer.status == 0
    assert "Clear the space around the arm" in answer.out
    assert file.read_text().startswith("t,q1,q2")
