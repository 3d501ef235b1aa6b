"""The campaign: seeded plans, plans by hand, faulty robots, rows and page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from bench.campaign import kinds, ledger
from bench.campaign.ledger import Drawn, Ledger, Row, drawn, judged
from bench.campaign.page import TITLES, page
from bench.faults import hidden, nasty, runtime
from bench.faults.bases import Base
from bench.faults.corrupt import corrupted
from bench.faults.faulty import FaultyRobot, broken, frozen
from bench.faults.kinds import FAULTS
from bench.faults.nasty import SMALL_SCENES, small_scene
from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.planning.check.check import RULES, check
from palpate.planning.plan import parse_plan
from tests.helpers.standin import StandIn


def can() -> Base:
    """A valid plan on a small scene: weigh the can."""
    (case,) = [case for case in nasty.NASTY if case.name == "known"]
    return Base("can:hand", small_scene("can"), None, case.plan, mishap=False)


def test_a_seed_and_a_number_are_a_plan() -> None:
    base = can()
    first, again, other = (corrupted(base, np.random.default_rng([1, n])) for n in (5, 5, 6))
    assert first == again
    assert first != other
    assert first.changes


def test_corrupted_plans_are_read_or_refused_and_never_break_the_check() -> None:
    base, accepted = can(), 0
    for number in range(150):
        made = corrupted(base, np.random.default_rng([2, number]))
        try:
            plan = parse_plan(made.text)
        except InputError:
            continue
        accepted += not check(plan, base.scene, remeasure=True)
    assert accepted < 75


def test_nasty_plans_stand_against_every_rule() -> None:
    assert len(nasty.NASTY) >= 60
    assert len({case.name for case in nasty.NASTY}) == len(nasty.NASTY)
    assert {case.scene.removesuffix("?") for case in nasty.NASTY} <= set(SMALL_SCENES)
    broken_rules: set[str] = set()
    for case in nasty.NASTY:
        asked = None if case.requested is None else map(Parameter, case.requested)
        broken_rules |= {f.rule for f in check(case.plan, small_scene(case.scene), requested=asked)}
    assert broken_rules <= set(RULES)
    assert len(broken_rules) >= 22


def test_a_nasty_plan_is_refused_with_its_rule_or_judged() -> None:
    by_name = {case.name: case for case in nasty.NASTY}
    refused = judged(by_name["no such action"], nasty.judge)
    assert (refused.outcome, refused.figures["rules"]) == ("refused", ["unknown-primitive"])
    assert "--case 'no such action'" in refused.command


@pytest.mark.parametrize(
    ("name", "harm", "leaf"),
    [
        # The check sees two things beside each other; that they are joined, physics knows.
        ("one of a pair", "two moved by", "MovePose(one_pose + z_offset)"),
    ],
)
def test_a_plan_whose_harm_is_physics_is_refused_by_the_rehearsal(
    name: str, harm: str, leaf: str
) -> None:
    (case,) = [case for case in nasty.PHYSICS if case.name == name]
    refused = judged(case, nasty.judge)
    assert (refused.outcome, refused.figures["rules"]) == ("refused", ["rehearsal"])
    assert harm in refused.said[0]
    assert leaf in refused.said[0]


def test_a_load_at_the_far_end_of_its_carrier_is_refused_by_the_check() -> None:
    (case,) = [case for case in nasty.PHYSICS if case.name == "weight at the far end"]
    refused = judged(case, nasty.judge)
    assert (refused.outcome, refused.figures["rules"]) == ("refused", ["unsupported"])
    assert "ruler" in refused.said[0]


def test_a_probe_that_would_push_a_pole_away_is_refused_by_the_check() -> None:
    (case,) = [case for case in nasty.PHYSICS if case.name == "probes a pole from the side"]
    refused = judged(case, nasty.judge)
    assert (refused.outcome, refused.figures["rules"]) == ("refused", ["precondition"])
    assert "the probe would push 'pole' away" in refused.said[0]


def test_sensible_plans_pass_the_check() -> None:
    assert len({case.name for case in nasty.SENSIBLE}) == len(nasty.SENSIBLE) >= 60
    for case in nasty.SENSIBLE:
        assert not check(case.plan, small_scene(case.scene), requested=case.asked), case.name


class Sound:
    """Stands for a simulated robot in which nothing happens."""

    class World:
        model = mujoco.MjModel.from_xml_string(
            '<mujoco><worldbody><body name="thing"><freejoint/><geom size=".1"/></body></worldbody></mujoco>'
        )
        watch = None

        def data(self) -> mujoco.MjData:
            return mujoco.MjData(self.model)

    def __init__(self) -> None:
        self.world = self.World()
        self.state = StandIn().state
        self.advanced = 0

    def advance(self, duration: float) -> None:
        self.advanced += 1
        self.state = replace(self.state, t=self.state.t + duration, q=self.state.q + 1)


def test_a_faulty_robot_is_sound_until_its_moment() -> None:
    inner = Sound()
    robot = FaultyRobot(inner, moment=inner.state.t + 0.03)  # pyright: ignore[reportArgumentType]
    robot.lie, robot.raises = broken("q", float("nan"), 3), {"advance": ConnectionError("gone")}
    robot.advance(0.02)
    assert np.isfinite(robot.state.q).all()
    robot.advance(0.02)
    assert np.isnan(robot.state.q).tolist() == [False] * 3 + [True] + [False] * 3
    with pytest.raises(ConnectionError):
        robot.advance(0.02)
    robot.once = True
    robot.advance(0.02)
    assert inner.advanced == 3
    robot.once, robot.lie, before = False, frozen("q"), robot.seen
    assert before is not None
    assert (robot.state.q == before.q).all()


def test_runtime_has_sixty_kinds_of_faults_at_five_moments() -> None:
    assert len(FAULTS) >= 60
    assert len(runtime.CASES) == 5 * len(FAULTS)
    assert len({case.name for case in runtime.CASES}) == len(runtime.CASES)


def test_ledger_keeps_rows_and_executes_only_missing_cases(tmp_path: Path) -> None:
    done: list[int] = []

    def work(case: Drawn, blank: Row) -> Row:
        done.append(case.number)
        beyond = ("table hit",) if case.number == 1 else ()
        touch = {"thing": "table", "part": "hand", "load": False, "peak": 90.0, "mean10": 70.0}
        touch |= {"mean20": 50.0, "tail": 3.0, "over": 0.0, "sideways": 1.0}
        return replace(blank, what="<what>", outcome="complete", beyond=beyond, touches=(touch,))

    first = Ledger(tmp_path / "nasty.jsonl")
    first.complete(drawn("nasty", 5, 2), work)
    with first.file.open("a", encoding="utf-8") as file:
        file.write('{"kind": "nasty", "case"')  # the process was killed while it wrote
    rows = Ledger(first.file).complete(drawn("nasty", 5, 3), work)
    assert done == [0, 1, 2]
    assert [row.case for row in rows] == ["5/0", "5/1", "5/2"]
    kinds.write(tmp_path)
    html = (tmp_path / "campaign.html").read_text(encoding="utf-8")
    assert "table hit" in html
    assert "&lt;what&gt;" in html
    assert "<what>" not in html


def test_a_page_without_rows_has_a_heading() -> None:
    assert "<h1>" in page({}, "nothing")


@pytest.mark.long
def test_a_case_is_repeated_by_its_number_or_name() -> None:
    row = kinds.repeat("nasty", "six angles", 0)
    assert row.outcome == "refused"
    with pytest.raises(InputError, match="six angles"):
        kinds.repeat("nasty", "six angels", 0)
    with pytest.raises(InputError, match="runtime"):
        kinds.repeat("rutime", "1", 0)
    with pytest.raises(InputError, match="numbers"):
        kinds.repeat("plans", "six", 0)


def test_a_case_that_fails_or_hangs_is_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(case: Drawn, blank: Row) -> Row:
        raise ZeroDivisionError("the arm is nowhere")

    def hang(case: Drawn, blank: Row) -> Row:
        while True:
            pass

    crashed = judged(Drawn("plans", 0, 1), fail)
    assert (crashed.outcome, crashed.case) == ("crashed", "0/1")
    assert "ZeroDivisionError: the arm is nowhere" in crashed.crash
    monkeypatch.setattr(ledger, "LONGEST", 0.1)
    assert judged(Drawn("plans", 0, 1), hang).outcome == "hung"


def test_every_kind_of_case_has_a_title() -> None:
    assert list(kinds.KINDS) == list(TITLES)


def test_a_random_case_is_named_by_its_command() -> None:
    assert Drawn("plans", 3, 14).command.endswith("--kind plans --seed 3 --case 14")


@pytest.mark.parametrize("stiffness", [1e5, 1e6])
@pytest.mark.parametrize("mass", [4.0, 18.0])
def test_a_post_has_the_stated_stiffness_under_any_load(stiffness: float, mass: float) -> None:
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="0.0005" integrator="implicitfast" gravity="0 0 0"/><worldbody>
        {hidden.post((0.05, 0.0, 0.0), stiffness)}
        <body pos="-0.01 0 0.1"><joint name="x" type="slide" axis="1 0 0" damping="3000"/>
        <geom type="sphere" size="0.045" mass="{mass}"/></body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    where = []
    for force in (100.0, 200.0):
        data.qfrc_applied[model.joint("x").dofadr[0]] = force
        mujoco.mj_step(model, data, nstep=4000)
        where.append(data.joint("x").qpos[0])
    assert 100.0 / (where[1] - where[0]) == pytest.approx(stiffness, rel=0.1)
