"""The front door: every program that the design promises, on a scene of a few lines."""

from __future__ import annotations

import gc
import json
import shutil
import subprocess
import sys
import weakref
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import palpate as pp
from palpate.estimation.estimate import not_identified
from palpate.planning.plan import Plan

DESK = """<mujoco model="desk"><worldbody>
  <site name="robot_base"/>
  <body name="desk" pos="0.4 0 ?"><geom type="box" size=".6 .6 .03" friction="0.6 0.005 0.0001"/></body>
  <body name="mug" pos="0.5 0.1 0.05"><freejoint/>
    <geom type="box" size=".03 .02 .05" friction="0.6 0.005 0.0001"/></body>
</worldbody></mujoco>
"""
WORLD = DESK.replace("0.4 0 ?", "0.4 0 -0.032").replace(".03 .02 .05", '.03 .02 .05" mass="0.34')
REQUEST = "how heavy is the mug?"
MASS = pp.Parameter("mug.mass")


@pytest.fixture(scope="module")
def done() -> pp.Run:
    return pp.run(DESK, REQUEST, world=WORLD, noise="lab")


@pytest.fixture(scope="module")
def folder(done: pp.Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("runs") / "mug"
    assert done.save(path).folder == path
    return path


def test_the_estimates_of_a_stored_trace_are_made_again(done: pp.Run, folder: Path) -> None:
    before = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    again = pp.open(folder).estimate()
    assert again["mug.mass"].values == done["mug.mass"].values
    assert again["mug.mass"].shared == done["mug.mass"].shared
    assert again.finished is None
    single = done.estimate({"mass": "single-shot"})["mug.mass"]
    assert single.values == done["mug.mass"].parts["single-shot"].value
    assert {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()} == before


def test_no_estimates_are_made_again_without_a_trace_or_of_another_version(
    done: pp.Run, folder: Path, tmp_path: Path
) -> None:
    with pytest.raises(pp.InputError, match="contrast, recording, rests-and-passes, single-shot"):
        done.estimate({"mass": "guess"})
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    (copy / "trace.mcap").unlink()
    with pytest.raises(pp.InputError, match="has no trace"):
        pp.open(copy).estimate()
    request = (copy / "request.json").read_text()
    (copy / "request.json").write_text(request.replace(pp.__version__, "0.0.7"))
    with pytest.raises(pp.InputError, match=r"recorded by palpate 0\.0\.7"):
        pp.open(copy).estimate()


def test_a_run_measures_what_was_asked_in_memory(done: pp.Run) -> None:
    assert done.status == "complete"
    assert done.folder is None
    assert [e.parameter for e in done.estimates] == [MASS]


def test_an_estimate_is_found_by_name_and_says_what_it_is(done: pp.Run) -> None:
    mass = done["mug.mass"]
    assert mass is done[MASS]
    assert mass.values == pytest.approx([0.34], rel=0.01)
    assert mass.unit == "kg"
    assert mass.intervals[0, 0] < 0.34 < mass.intervals[0, 1]
    assert abs(mass.z_score(0.34)) < 3
    assert repr(mass).startswith("<mug.mass = 0.3")
    assert repr(mass).endswith("identified, simulated>")


def test_an_unmeasured_parameter_is_named_with_the_measured_ones(done: pp.Run) -> None:
    with pytest.raises(KeyError, match=r"'desk.height' was not measured .* measured: mug.mass"):
        done["desk.height"]
    with pytest.raises(pp.InputError, match="'mug' names no parameter"):
        done["mug"]


def test_a_scene_says_what_it_misses() -> None:
    scene = pp.load(DESK)
    assert scene.missing == (pp.Parameter("desk.height"), pp.Parameter("mug.mass"))
    assert repr(scene) == "<Scene 'desk': 1 object, 1 surface, 2 missing>"


def test_a_printed_scene_has_one_line_a_body() -> None:
    scene = pp.load(DESK)
    lines = str(scene).splitlines()
    assert lines[0] == repr(scene)
    assert [line.split()[1].rstrip(":") for line in lines[1:]] == list(scene.bodies)


@pytest.mark.parametrize(
    ("wrong", "named"),
    [({"seed": -1}, "seed="), ({"noise": "loud"}, "noise"), ({"out": "."}, "out=")],
)
def test_an_impossible_run_is_refused_before_planning(wrong: dict[str, Any], named: str) -> None:
    class Unasked:
        name = "unasked"

        def plan(self, *_: object) -> pp.Plan:
            raise AssertionError("somebody planned")

    with pytest.raises(pp.InputError, match=named):
        pp.run(DESK, "how heavy is the mug?", planner=Unasked(), **wrong)


def test_a_question_is_answered() -> None:
    run = pp.run(DESK, "is the mug heavier than 300 g?", world=WORLD, noise="lab", fast=True)
    assert str(run.answer).startswith("yes: mug 0.34")
    assert "against 0.3 kg (p < 1e-06)" in str(run.answer)
    trace = weakref.ref(run.trace)
    del run
    gc.collect()
    assert trace() is None, "no cache keeps the trace of a run"


def test_a_run_reports_its_stages(tmp_path: Path) -> None:
    messages: list[str] = []
    pp.run(
        DESK, "how heavy is the mug?", noise="none", out=tmp_path / "run", progress=messages.append
    )
    assert (messages[0], messages[-1]) == ("planning", "writing the report")


def test_drawn_values_do_not_look_measured(tmp_path: Path) -> None:
    drawn = pp.run(DESK, REQUEST, noise="none", seed=1, out=tmp_path / "run", fast=True)
    assert drawn.drawn
    result = json.loads((tmp_path / "run" / "result.json").read_text("utf-8"))
    assert (result["simulated"], result["truth"]) == (True, "drawn from priors")
    assert "drawn from priors" in result["parameters"][0]["method"]
    assert "drawn from priors" in (tmp_path / "run" / "twin.xml").read_text("utf-8")
    assert "drawn from priors (seed 1)" in (tmp_path / "run" / "report.html").read_text("utf-8")


def test_values_of_a_world_are_not_called_drawn(done: pp.Run, folder: Path) -> None:
    assert not done.drawn
    assert "drawn" not in (folder / "twin.xml").read_text("utf-8")
    assert "made up" not in (folder / "report.html").read_text("utf-8")


def test_a_scene_comes_from_a_file_too(tmp_path: Path) -> None:
    file = tmp_path / "desk.xml"
    file.write_text(DESK, encoding="utf-8")
    assert pp.load(str(file)).missing == pp.load(file).missing == pp.load(DESK).missing
    assert pp.load(file).path == file


def test_a_parameters_name_is_split_at_its_last_dot() -> None:
    dotted = pp.Parameter("cup.v2.mass")
    assert (dotted.object, dotted.quantity) == ("cup.v2", "mass")
    assert dotted == pp.Parameter("cup.v2", "mass")
    assert repr(dotted) == "Parameter('cup.v2.mass')"


def test_a_plan_shows_itself_its_tree_and_its_reason() -> None:
    plan = pp.load(DESK).plan(REQUEST)
    assert repr(plan) == f"<Plan by symbolic: mug.mass, {plan.actions} actions>"
    assert plan.findings == ()
    assert plan.tree is not None
    first, second, *rest = str(plan).splitlines()
    assert (first, second) == (repr(plan), "Sequence")
    assert all(line.startswith("  ") for line in rest)
    assert "mug" in plan.explanation


def test_an_impossible_plan_is_a_rejection_with_a_reason() -> None:
    plan = pp.load(DESK).plan("the temperature of the mug")
    assert plan.tree is None
    assert repr(plan).startswith("<Plan by symbolic: rejected: ")
    assert "temperature" in repr(plan)
    rejected = plan.run()
    assert rejected.status == "rejected"
    assert rejected.trace_if_any is None
    with pytest.raises(pp.InputError, match="no trace: its plan was rejected"):
        _ = rejected.trace
    with pytest.raises(pp.InputError, match="no twin: its plan was rejected"):
        _ = rejected.twin
    assert repr(rejected).startswith("<Run rejected: The temperature cannot be measured: ")


class Nothing:
    """A planner that measures nothing."""

    name = "nothing"

    def plan(self, request: str | None, scene: object, images: object = ()) -> Plan:
        return Plan((), None, f"'{request}' is a matter of opinion.", self.name)


def test_a_planner_of_ones_own_is_handed_over() -> None:
    plan = pp.load(DESK).plan("is the mug beautiful?", planner=Nothing())
    assert repr(plan) == f"<Plan by nothing: rejected: {plan.explanation}>"
    assert plan.explanation == "'is the mug beautiful?' is a matter of opinion."


class Own:
    """A planner that returns the public `Plan`."""

    name = "own"

    def plan(self, request: str | None, scene: object, images: object = ()) -> pp.Plan:
        return pp.Plan((), None, "Nothing can be measured.", self.name)


def test_a_planner_of_ones_own_may_return_the_public_plan() -> None:
    plan = pp.load(DESK).plan("the mass of the mug", planner=Own())
    assert plan.explanation == "Nothing can be measured."
    assert plan.run().status == "rejected"


def test_a_plan_that_was_not_checked_is_not_run() -> None:
    plan = pp.Plan((), None, "Nothing can be measured.")
    with pytest.raises(pp.InputError, match=r"Scene\.plan"):
        plan.run()


def test_a_scalar_estimate_is_a_number(done: pp.Run) -> None:
    mass = done["mug.mass"]
    assert float(mass) == mass.value == mass.values[0]
    assert isinstance(mass.std, float)
    low, high = mass.ci95
    assert low < float(mass) < high


def test_blas_is_limited_while_a_plan_runs_and_as_the_user_left_it_after() -> None:
    from threadpoolctl import threadpool_info, threadpool_limits

    def threads() -> set[int]:
        return {each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"}

    seen: list[set[int]] = []
    with threadpool_limits(2, "blas"):
        pp.load(DESK).plan(REQUEST).run(fast=True, progress=lambda _: seen.append(threads()))
        assert threads() == {2}
    assert seen[-1] == {1}


def test_a_plan_runs_in_a_cell_that_is_handed_over() -> None:
    messages: list[str] = []
    cell = pp.SimulatedCell(pp.load(WORLD), noise="none")
    run = pp.load(DESK).plan(REQUEST).run(cell, progress=messages.append, fast=True)
    assert run["mug.mass"].values == pytest.approx([0.34], rel=0.01)
    assert run.truth[MASS] == (0.34,)
    assert messages[:2] == ["executing on the simulated robot", "estimating"]


@pytest.mark.long
def test_the_same_seed_gives_the_same_run() -> None:
    plan = pp.load(DESK).plan(REQUEST)
    first, second = plan.run(seed=3, fast=True), plan.run(seed=3, fast=True)
    assert first.estimates == second.estimates
    assert first.truth == second.truth


def test_the_trace_has_the_wrench_and_columns_of_every_sample(done: pp.Run) -> None:
    assert done.trace.wrench.shape == (len(done.trace.t), 6)
    columns = done.trace.columns()
    assert np.array_equal(columns["wrench_fz"], done.trace.wrench[:, 2])
    assert {len(values) for values in columns.values()} == {len(done.trace.t)}
    assert len(columns) == 2 + 7 + 7 + 7 + 6 + 7 + 6 + 7


def test_a_data_frame_needs_pandas(done: pp.Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(pp.Unavailable, match="pip install pandas"):
        done.trace.to_dataframe()


def test_a_data_frame_has_one_row_a_sample(done: pp.Run) -> None:
    pytest.importorskip("pandas")
    assert len(done.trace.to_dataframe()) == len(done.trace.t)


class Frame:
    """Stands for pandas, of which the data frame alone is used."""

    def __init__(self, columns: dict[str, list[Any]]) -> None:
        self.columns = columns


def test_a_run_is_a_container_of_its_parameters(
    done: pp.Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert list(done) == [MASS]
    assert len(done) == 1
    assert [done[parameter] for parameter in done] == list(done.estimates)
    assert "mug.mass" in done
    assert MASS in done
    assert "desk.height" not in done
    assert "mug" not in done
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(pp.Unavailable, match="pip install pandas"):
        done.to_dataframe()
    monkeypatch.setitem(sys.modules, "pandas", type("pandas", (), {"DataFrame": Frame}))
    mass, columns = done["mug.mass"], done.to_dataframe().columns
    row = {name: values for name, (values,) in columns.items()}  # type: ignore[misc]
    assert row == {
        "object": "mug",
        "quantity": "mass",
        "value": mass.value,
        "std": mass.std,
        "unit": "kg",
        "ci95": mass.ci95,
        "verdict": "identified",
        "method": mass.method,
    }


def test_fusion_and_comparison_are_containers_too(done: pp.Run) -> None:
    again = pp.run(DESK, REQUEST, world=WORLD, noise="lab", seed=1, fast=True)
    fused, compared = pp.fuse([done, again]), pp.compare([done, again])
    for several in (fused, compared):
        assert (list(several), len(several), "mug.mass" in several) == ([MASS], 1, True)
        with pytest.raises(KeyError, match=r"'mug.com' is in none of the runs; there is mug.mass"):
            several["mug.com"]
    assert fused[MASS].unit == "kg"
    assert len(compared[MASS]) == 2


NO_ARGUMENT = [
    (pp.run, (DESK, REQUEST), "sed", "seed"),
    (pp.run, (DESK, REQUEST), "mesure", "measure"),
    (pp.load, (DESK,), "pose", "poses"),
    (pp.load(DESK).plan, (REQUEST,), "mesure", "measure"),
    (pp.load(DESK).plan().run, (), "nois", "noise"),
    (pp.estimate, ("log.csv",), "load", "loaded"),
    (pp.dynamics, ("log.csv",), "column", "columns"),
    (pp.noise, ("log.csv",), "column", "columns"),
    (pp.see, (DESK, "0"), "intrinsic", "intrinsics"),
    (pp.open, (), "foldr", "folder"),
    (pp.fuse, (), "run", "runs"),
    (pp.compare, (), "run", "runs"),
]


@pytest.mark.parametrize(("verb", "given", "wrong", "meant"), NO_ARGUMENT)
def test_an_unknown_keyword_is_a_type_error_that_names_the_nearest(
    verb: Any, given: tuple[str, ...], wrong: str, meant: str
) -> None:
    with pytest.raises(TypeError, match=f"no argument '{wrong}'; did you mean '{meant}'"):
        verb(*given, **{wrong: None})


def test_an_unknown_keyword_lists_the_valid_ones() -> None:
    with pytest.raises(TypeError, match="no argument 'xyzzy'; it takes source, poses, arm"):
        pp.load(DESK, xyzzy=1)  # type: ignore[call-arg]


@pytest.mark.parametrize("loaded", [3, (12.0,), ["a", "b"], (1.0, 2.0, 3.0)])
def test_windows_of_another_form_are_shown_the_form(loaded: Any) -> None:
    with pytest.raises(pp.InputError, match=r"loaded=.*: give \(start, stop\)"):
        pp.estimate("log.csv", loaded=loaded)


def test_a_parameter_may_be_named_by_itself() -> None:
    assert pp.load(DESK).plan(measure=MASS).parameters == (MASS,)
    assert pp.load(DESK).plan(measure=None).run_so_far.settings.measure == ()


def test_an_invalid_planner_is_named() -> None:
    with pytest.raises(pp.InputError, match="planner=: Input should be a valid string"):
        pp.load(DESK).plan(REQUEST, planner=3)  # type: ignore[arg-type]
    with pytest.raises(
        pp.InputError, match=r"measure=: .* text, or a list of texts, not 3. Parameter"
    ):
        pp.load(DESK).plan(measure=3)  # type: ignore[arg-type]


def test_every_planner_names_unusable_options() -> None:
    for images in ("missing.png", ["missing.png"]):
        with pytest.raises(pp.InputError, match=r"cannot read missing\.png"):
            pp.load(DESK).plan(measure=MASS, images=images)
    plan = pp.load(DESK).plan(measure=MASS, within={"height": "1mm", "mass": "5g"})
    assert any("within=height has no effect" in note for note in plan.notes)
    assert not any("within=mass" in note for note in plan.notes)


CRATE = DESK.replace(
    "</worldbody>",
    '<body name="crate" pos="0.5 -0.2 0.1"><freejoint/><geom type="box" size=".1 .1 .1"/></body></worldbody>',
)


def test_a_requested_parameter_that_no_plan_measures_leaves_the_run_incomplete(
    tmp_path: Path,
) -> None:
    plan = pp.load(CRATE).plan(measure="mug.mass,crate.mass")
    assert plan.parameters == (MASS,)
    run = plan.run(noise="none", out=tmp_path / "run", fast=True)
    assert run.status == "failed"
    assert [item.verdict for item in run.estimates] == ["identified", "not identified"]
    assert "200 mm wide" in run["crate.mass"].method
    (line,) = run.shortfalls
    assert line.startswith("crate.mass: The mass of 'crate' cannot be measured: 'crate' cannot be")
    assert repr(run).startswith("<Run failed: mug.mass = ")
    assert "crate.mass unknown; crate.mass: The mass of 'crate' cannot be measured" in repr(run)
    again = pp.open(tmp_path / "run")
    assert (repr(again), again.shortfalls, again.plan) == (repr(run), run.shortfalls, run.plan)
    assert [item.verdict for item in again.estimate().estimates] == ["identified", "not identified"]
    # The plan's file says so, too.
    replayed = pp.run(CRATE, planner=f"replay:{tmp_path / 'run'}", noise="none", fast=True)
    assert replayed.status == "failed"


def test_a_plan_of_others_that_leaves_out_what_is_asked_for_is_not_complete(tmp_path: Path) -> None:
    pp.load(CRATE).plan(measure="mug.mass").run(noise="none", out=tmp_path / "run", fast=True)
    replay = f"replay:{tmp_path / 'run' / 'plan.json'}"
    run = pp.run(CRATE, planner=replay, measure="mug.mass,crate.mass", noise="none", fast=True)
    assert run.status == "failed"
    assert run.shortfalls == ("crate.mass: The plan does not measure it.",)


def test_the_reason_of_a_failed_run_says_why_a_value_is_not_identified(done: pp.Run) -> None:
    doubtful = replace(done.estimates[0], verdict="prior-dominated")
    believed = (
        "mug.mass: prior-dominated (the recordings say no more than what was believed before)"
    )
    assert replace(done, estimates=(doubtful,)).reason == believed
    missing = not_identified(MASS, "kg", "It slipped.")
    assert replace(done, estimates=(missing,)).reason == "mug.mass: not identified (It slipped)"


def test_a_value_that_has_no_place_in_the_twin_leaves_the_run_incomplete(done: pp.Run) -> None:
    notes = ("mug.mass is not in the twin: a weld decides it", "desk.height is assumed")
    without = replace(done, finished=replace(done.twin, unwritten=(MASS,), notes=notes))
    assert (without.status, without.reason) == ("failed", notes[0])
    assert (
        repr(without)
        == f"<Run failed: mug.mass = {done['mug.mass'].value:.4g}; {notes[0]}, simulated>"
    )
    other = replace(done.twin, unwritten=(pp.Parameter("desk.size"),), notes=notes)
    assert replace(done, finished=other).status == "complete", "nobody asked for it"


def test_a_property_that_nothing_measures_leaves_the_run_incomplete() -> None:
    run = pp.run(DESK, "the mass and the temperature of the mug", noise="none", fast=True)
    assert run.status == "failed"
    assert list(run) == [MASS]
    assert "temperature" in run.shortfalls[0]


def test_why_several_quantities_of_one_object_cannot_be_measured_is_reported_for_each() -> None:
    plan = pp.load(CRATE).plan(measure="crate.mass,crate.friction,mug.mass")
    (item,) = plan.unmeasured
    assert [str(parameter) for parameter in item.parameters] == ["crate.mass", "crate.friction"]
    assert "200 mm wide" in item.reason


def test_the_twin_is_text_a_model_and_a_file(done: pp.Run, tmp_path: Path) -> None:
    model = done.twin.mjmodel
    assert isinstance(model, mujoco.MjModel)
    assert model.body("mug").mass[0] == pytest.approx(done["mug.mass"].values[0], rel=1e-3)
    done.twin.save(tmp_path / "twin.xml")
    assert (tmp_path / "twin.xml").read_text(encoding="utf-8") == done.twin.xml
    assert pp.load(tmp_path / "twin.xml").missing == ()


def test_a_folder_gives_the_run_back(done: pp.Run, folder: Path) -> None:
    again = pp.open(folder)
    assert repr(again) == repr(done)
    assert (again.status, again.plan, again.findings) == (done.status, done.plan, ())
    assert again.settings == done.settings
    assert again.scene.text == DESK
    assert again.world == done.world
    assert (again.estimates, again.truth) == (done.estimates, done.truth)
    assert (again.twin.xml, again.twin.diff, again.twin.notes, again.twin.validation) == (
        done.twin.xml,
        done.twin.diff,
        done.twin.notes,
        done.twin.validation,
    )


def test_its_trace_is_the_files(done: pp.Run, folder: Path) -> None:
    kept, again = done.trace, pp.open(folder).trace
    assert kept is not None
    assert again is not None
    assert (again.leaves, again.recordings) == (kept.leaves, kept.recordings)
    for name, values in kept.columns().items():
        assert np.array_equal(again.columns()[name], values), name


def test_an_opened_run_can_be_saved_again(folder: Path, tmp_path: Path) -> None:
    copy = pp.open(folder).save(tmp_path / "copy")
    assert repr(pp.open(tmp_path / "copy")) == repr(copy)
    for name in ("plan.json", "scene.xml", "twin.xml", "trace.mcap"):
        assert (tmp_path / "copy" / name).read_bytes() == (folder / name).read_bytes()


def test_a_rejection_is_kept_and_read_too(tmp_path: Path) -> None:
    rejected = pp.load(DESK).plan("the temperature of the mug").run(out=tmp_path / "run")
    again = pp.open(tmp_path / "run")
    assert (again.status, again.plan) == ("rejected", rejected.plan)
    assert again.trace_if_any is again.finished is again.execution is None


@pytest.mark.long
def test_a_stored_measurement_outlives_the_scenes_file(tmp_path: Path) -> None:
    file = tmp_path / "desk.xml"
    file.write_text(DESK, encoding="utf-8")
    run = pp.run(file, REQUEST, noise="none", out=tmp_path / "run", fast=True)
    assert pp.open(tmp_path / "run").scene.text == DESK
    file.unlink()
    again = pp.open(tmp_path / "run")
    assert again["mug.mass"].values.tolist() == run["mug.mass"].values.tolist()
    assert again.twin.xml == run.twin.xml
    assert again.scene.bodies == {}
    with pytest.raises(pp.InputError, match=r"scene, '.*desk.xml', is missing: put it back"):
        again.estimate()


def test_a_folder_that_is_no_run_is_named(tmp_path: Path) -> None:
    with pytest.raises(pp.InputError, match=r"is not a run.s folder: .*request\.json"):
        pp.open(tmp_path)


def test_a_folder_is_made_where_one_is_asked_for(tmp_path: Path) -> None:
    run = pp.run(DESK, "the velocity of the gripper", noise="none", out=tmp_path / "run")
    assert run.folder == tmp_path / "run"
    assert (run.folder / "result.json").exists()
    with pytest.raises(pp.InputError, match="exists already"):
        pp.run(DESK, REQUEST, out=tmp_path / "run")


def test_everything_answers_in_one_short_line(done: pp.Run) -> None:
    bodies = (done, done.scene, done.plan, done.trace, done.twin, done.estimates[0], MASS)
    for item in (*bodies, pp.load(DESK).plan(REQUEST), pp.load(DESK).arm):
        assert "\n" not in repr(item)
        assert len(repr(item)) < 160


def test_a_notebook_shows_small_tables_and_escapes_text_of_the_user(done: pp.Run) -> None:
    nasty = DESK.replace('"mug"', '"&lt;b&gt;mug"')
    scene = pp.load(nasty)
    shown = scene._repr_html_()
    assert shown.startswith("<table>")
    assert "<b>" not in shown
    for item in (done, done.trace, done.twin, scene.plan(), done.estimates[0]):
        assert "<table>" in item._repr_html_()  # type: ignore[union-attr]


def test_every_public_name_is_there_and_has_a_docstring() -> None:
    assert 20 <= len(pp.__all__) <= 29
    for name in pp.__all__:
        assert getattr(pp, name).__doc__, name
    assert set(pp.__all__) <= set(dir(pp))
    with pytest.raises(AttributeError, match="palpate has no 'weigh'; it has "):
        pp.weigh  # noqa: B018


def test_a_run_without_estimates_is_true() -> None:
    run = pp.load(DESK).plan("the temperature of the mug").run()
    assert (len(run), bool(run)) == (0, True)


def test_importing_it_loads_nothing() -> None:
    code = "import sys; import palpate; print(*[m for m in sys.modules if 'palpate.' in m or m in ('numpy', 'mujoco')])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_a_wrong_argument_is_named_as_it_is_written_in_python() -> None:
    with pytest.raises(pp.InputError, match="seed= must not be negative"):
        pp.load(DESK).plan(REQUEST).run(seed=-1)
    with pytest.raises(pp.InputError, match="world= and robot= exclude each other"):
        pp.load(DESK).plan(REQUEST).run(world="w.xml", robot="franky://host")
    with pytest.raises(pp.Unavailable, match="no driver for 'nobody://host'"):
        pp.load(DESK).plan(REQUEST).run(robot="nobody://host")


def test_a_run_can_be_changed_and_kept_as_a_value(done: pp.Run) -> None:
    assert replace(done, folder=Path("x")).folder == Path("x")
