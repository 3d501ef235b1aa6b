"""`palpate dynamics LOG`."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from moving_arm import recorded

from palpate.robots.owner import load_description

from .conftest import Answer

Call = Callable[..., Answer]
ARM = load_description("fr3")


def log(hand: float = 0.9, seconds: float = 12.0) -> None:
    run = recorded(ARM, hand, seconds=seconds)
    np.savez("log.npz", t=run.t, q=run.q, dq=run.dq, tau=run.tau, tau_ext=0.1 * run.tau)


def test_dynamics_are_shown_and_written(palpate: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    log()
    monkeypatch.setenv("COLUMNS", "80")
    done = palpate("dynamics", "log.npz", "-o", "arm.xml")
    assert done.status == 0, done.err
    lines = done.out.splitlines()
    heading = "joint friction N m damping N m s/rad armature kg m² offset N m"
    assert lines[0].split() == heading.split()
    assert [line.split()[0] for line in lines[1:8]] == [*"1234567"]
    assert max(len(line) for line in lines if not line.startswith("written to")) <= 80
    for row in ("hand 0.", "as described", "friction identified", "all identified", "tau_ext of"):
        assert row in done.out
    assert mujoco.MjModel.from_xml_path("arm.xml").joint("fr3_joint1").frictionloss[0] > 0.2


def test_the_dynamics_of_an_arm_are_printed_as_json(palpate: Call) -> None:
    log()
    done = palpate("dynamics", "log.npz", "--hand", "0.9kg", "--json")
    assert done.status == 0, done.err
    document = json.loads(done.out)
    assert document["arm"] == "fr3"
    assert document["hand"] is None
    assert document["files"] == []
    assert [joint["joint"] for joint in document["joints"]] == list(ARM.joints)
    assert document["joints"][3]["coulomb"]["std"] > 0.0
    assert set(document["rms"]) == {"described", "friction", "all", "controller"}
    assert len(document["links"]) == 7


def test_a_wrong_recording_is_contradicted_and_not_written(palpate: Call) -> None:
    run = recorded(ARM, 0.9, seconds=6.0)
    np.savez("log.npz", t=run.t, q=run.q, dq=run.dq, tau=-run.tau)
    done = palpate("dynamics", "log.npz", "-o", "arm.xml")
    assert done.status == 1
    text = " ".join(done.out.split())
    assert "contradicted The described arm does not explain the torques: the torques have" in text
    assert "another arm (--arm NAME or a folder" in text
    # Every printed figure is marked.
    rows = [line for line in done.out.splitlines() if "±" in line]
    assert len(rows) >= 8
    assert all(line.count("(") == line.count("±") for line in rows)
    assert done.out.startswith("contradicted: figures in parentheses have no meaning")
    document = json.loads(palpate("dynamics", "log.npz", "--json").out)
    assert document["verdict"] == "contradicted"
    assert not Path("arm.xml").exists()
    noise = palpate("noise", "log.npz", "-o", "mine.yaml")
    assert noise.status == 2
    assert "have the opposite sign: negate them" in noise.err
    assert not Path("mine.yaml").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("missing.npz",), "missing.npz"),
        (("log.npz", "--hand", "heavy"), "--hand 'heavy' is neither 'found' nor a mass in kg"),
        (("log.npz", "--hand", "40"), "a hand of 40 kg is not between 0 and 3.76 kg"),
        (("log.npz", "--arm", "ur5"), "unknown arm 'ur5'"),
        (("log.npz", "-o", "log.npz"), "exists already"),
    ],
)
def test_bad_input_gets_one_line(palpate: Call, arguments: tuple[str, ...], message: str) -> None:
    log(seconds=6.0)
    done = palpate("dynamics", *arguments)
    assert done.status == 2
    assert message in done.err
    assert len(done.err.splitlines()) == 1
    assert Path("log.npz").is_file()
