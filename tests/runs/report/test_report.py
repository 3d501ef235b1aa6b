from __future__ import annotations

import base64
import gzip
import hashlib
import io
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from palpate.common.belief import Belief
from palpate.common.parameter import Parameter
from palpate.common.pose import Pose
from palpate.estimation.estimate import Estimate, FitTest, FurtherValue, not_identified
from palpate.execution.simulated_cell import DRAWN
from palpate.execution.stop import HeldObject
from palpate.perception.film import Film
from palpate.perception.renderer import png
from palpate.planning.check.finding import Finding
from palpate.planning.plan import Node, Plan
from palpate.runs.read import EMPTY_SCENE
from palpate.runs.report.cards import parameter_groups
from palpate.runs.report.changes import change
from palpate.runs.report.data import Pictures, ReportData
from palpate.runs.report.page import write_report
from palpate.runs.report.sections import NARROWEST, branches, first_failure, list_stop_actions
from palpate.runs.run import Ending, Run
from palpate.runs.settings import Settings
from palpate.scene.load import parse_scene
from palpate.trace.recording import Context, LeafRun, Recording
from palpate.twin.twin import Twin
from palpate.twin.validate import ReplayResidual, Validation

SQUARE = png(np.zeros((8, 8, 3), np.uint8))
HOSTILE = '</script><script>alert(1)</script><img src="http://evil.example/x" onerror=alert(1)>'
SECTIONS = (
    "Workspace",
    "Known and missing quantities",
    "Plan",
    "Forces and motion",
    "Digital twin",
)


class Page(HTMLParser):
    """What a browser would see: elements with attributes, text, and the content of scripts."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.texts: list[str] = []
        self.scripts: list[str] = []
        self._script = False
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, {name: value or "" for name, value in attrs}))
        self._script = tag == "script"

    def handle_endtag(self, tag: str) -> None:
        self._script = False

    def handle_data(self, text: str) -> None:
        (self.scripts if self._script else self.texts).append(text)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.texts).split())

    def all(self, tag: str) -> list[dict[str, str]]:
        return [attributes for name, attributes in self.elements if name == tag]


def ids(page: Page) -> set[str]:
    return {attributes["id"] for _, attributes in page.elements if "id" in attributes}


def page_of(data: ReportData, folder: Path) -> Page:
    write_report(folder / "report.html", data)
    return Page((folder / "report.html").read_text(encoding="utf-8"))


def picture(changed: bool = False) -> bytes:
    """Black, and where it is `changed` with a white corner."""
    pixels = np.zeros((8, 12, 3), np.uint8)
    pixels[:2, :3] = 255 if changed else 0
    return png(pixels)


def complete(data: ReportData) -> ReportData:
    film = Film(b"\0\0\0\x18ftypmp42", 2.5)
    taken = Pictures(picture(), picture(), picture(changed=True), film=film)
    return replace(data, pictures=taken, warnings=("a warning",))


def grown(data: ReportData, **changes: Any) -> ReportData:
    """The page of the run with some changes."""
    return replace(data, run=replace(data.run, **changes))


def measured(data: ReportData, *found: tuple[Estimate, tuple[float, ...] | None]) -> ReportData:
    """The page of a run with these estimates and true values."""
    truth = {item.parameter: value for item, value in found if value is not None}
    return grown(data, estimates=tuple(item for item, _ in found), truth=truth)


def stopped(data: ReportData, why: str, held: HeldObject | None = None, **more: Any) -> ReportData:
    """The page of the run after an early stop."""
    return grown(data, execution=Ending("stopped", why, 16, 31.0, 4.0, held=held), **more)


def test_all_sections_are_there(data: ReportData, tmp_path: Path) -> None:
    page = page_of(complete(data), tmp_path)
    for words in (
        *SECTIONS,
        data.run.settings.request,
        "0.2541",
        "± 0.0008",
        "0.2525 … 0.2557 kg",
        "hidden truth 0.254 kg",
        "+0.1 g",
        "inside the interval",
        "at 2.5 × robot time",
        "a warning",
        "16",
        "31.0 s",
        "lab",
        "single-shot 0.262 ± 0.020 kg",
        "? → 0.2541 kg",
        "mujoco",
        "MoveUntilContact(-z)",
        data.run.plan.explanation,
    ):
        assert str(words) in page.text, words
    assert len(page.all("img")) == 4
    assert page.all("video")[0]["src"].startswith("data:video/mp4;base64,")


def test_nothing_is_fetched(data: ReportData, tmp_path: Path) -> None:
    page = page_of(complete(data), tmp_path)
    for _, attributes in page.elements:
        for name in ("src", "href", "poster", "action", "data", "srcset"):
            assert re.match(r"data:|#?[\w./-]+$|$", attributes.get(name, "")), attributes
    policy = page.all("meta")[1]
    assert policy["http-equiv"] == "Content-Security-Policy"
    assert policy["content"].startswith("default-src 'none';")
    assert not any(attributes.get("src") for attributes in page.all("script") + page.all("link"))
    css = re.findall(r"<style>(.*?)</style>", (tmp_path / "report.html").read_text(), re.DOTALL)
    assert "url(" not in "".join(css)
    assert "@import" not in "".join(css)


def test_the_policy_names_the_scripts_that_are_there(data: ReportData, tmp_path: Path) -> None:
    page = page_of(data, tmp_path)
    policy = page.all("meta")[1]["content"]
    figure, packed, script = page.scripts[-3:]
    for source in (script.encode(), gzip.decompress(base64.b64decode(packed))):
        assert base64.b64encode(hashlib.sha256(source).digest()).decode() in policy
    assert json.loads(figure)["layout"]["xaxis"]["range"] == [0.0, pytest.approx(31.0)]


def test_hostile_names_are_text(data: ReportData, tmp_path: Path) -> None:
    parameter = Parameter(HOSTILE, HOSTILE)
    context = Context("still", at=HOSTILE, holding=HOSTILE)
    window = Recording("gripper_forces", 1.0, 2.0, context, HOSTILE)
    estimate = Estimate(
        parameter,
        HOSTILE,
        (1.0,),
        (0.1,),
        ((0.8, 1.2),),
        HOSTILE,
        (window,),
        parts={HOSTILE: FurtherValue(1.0, 0.1)},
    )
    leaf = LeafRun("tree.children[0]", HOSTILE, HOSTILE, 0.0, 1.0, "FAILURE", HOSTILE)
    trace = replace(data.run.trace, leaves=(leaf,), recordings=(window,), conversions=())
    plan = Plan(
        (parameter,),
        Node("Sequence", (), (Node(HOSTILE, (("pose", HOSTILE),), name=HOSTILE),), name=HOSTILE),
        HOSTILE,
        HOSTILE,
        (HOSTILE,),
    )
    diff = f"@@ {HOSTILE}\n-{HOSTILE}\n+{HOSTILE}!\n"
    residual = ReplayResidual(None, None, HOSTILE)
    run = replace(
        data.run,
        settings=Settings(request=HOSTILE),
        plan=plan,
        findings=(Finding(HOSTILE, "syntax", HOSTILE),),
        world=HOSTILE,
        execution=Ending("stopped", HOSTILE, 1, 1.0, 1.0),
        recorded=trace,
        estimates=(estimate,),
        truth={parameter: (1.1,)},
        finished=Twin("", diff, (HOSTILE,), Validation(True, 0.0, residual, residual)),
    )
    files = ("javascript:alert(1)", "../up", "good.xml", HOSTILE)
    hostile = ReportData(run, files=files, command=HOSTILE, warnings=(HOSTILE,))
    page = page_of(hostile, tmp_path)
    assert len(page.all("script")) == 3
    assert page.all("img") == []
    assert not any(name.startswith("on") for _, attributes in page.elements for name in attributes)
    linked = [a["href"] for a in page.all("a")]
    assert [link for link in linked if not link.startswith("#")] == ["good.xml"]
    assert {link[1:] for link in linked if link.startswith("#")} <= ids(page)
    assert HOSTILE in page.text
    figure = json.loads(page.scripts[-3])
    shown = [a["text"] for a in figure["layout"]["annotations"]] + figure["data"][-1]["text"]
    assert shown
    assert not any("<" in text for text in shown)


@pytest.mark.parametrize("status", ["rejected", "aborted", "failed", "complete"])
def test_a_bare_run_still_has_a_page(status: str, tmp_path: Path) -> None:
    wanted = Parameter("mug", "mass")
    heat = Plan((), None, "Heat cannot be felt.")
    done = Ending("complete", None, 0, 0.0, 0.0)
    states: dict[str, dict[str, Any]] = {
        "rejected": {"plan": heat},
        "aborted": {"plan": heat, "interrupted": "interrupted"},
        "failed": {"plan": replace(heat, parameters=(wanted,)), "execution": done},
        "complete": {"plan": replace(heat, declared="nothing_missing")},
    }
    run = Run(Settings(), parse_scene(EMPTY_SCENE), **states[status])
    assert run.status == status
    bare = ReportData(run)
    page = page_of(bare, tmp_path)
    assert "Heat cannot be felt." in page.text
    assert "All quantities that the scene does not state" in page.text
    assert ("The arm did not move." in page.text) == (status == "rejected")
    assert page.all("img") == page.all("video") == []
    assert "Forces and motion" not in page.text
    assert (tmp_path / "report.html").stat().st_size < 100_000


def test_an_aborted_run_says_why_and_shows_the_stop(data: ReportData, tmp_path: Path) -> None:
    trace = data.run.trace
    done = trace.leaves[:3]
    failed = replace(trace.leaves[3], status="FAILURE", message="unexpected contact of 21 N")
    stop = LeafRun("stop", "OpenGripper", "OpenGripper()", 8.0, 9.0, "SUCCESS", "open to 80 mm")
    trace = replace(trace, leaves=(*done, failed, stop), recordings=(), conversions=())
    lost = not_identified(Parameter("table", "height"), "m", "The run ended before.")
    page = page_of(
        stopped(data, "MovePose: unexpected contact", recorded=trace, estimates=(lost,)),
        tmp_path,
    )
    for words in (
        "Stopped safely",
        "MovePose: unexpected contact",
        "unexpected contact of 21 N",
        "Controlled stop",
        "not identified",
        "Next steps",
        "what the hand met",
        "--on-failure skip",
        "4 of 16",
    ):
        assert words in page.text, words
    assert "`" not in page.text
    assert "<code>--on-failure skip</code>" in (tmp_path / "report.html").read_text("utf-8")
    assert "Keep what was measured" not in page.text
    assert "#failed" in [a["href"] for a in page.all("a")]
    (leaf,) = [a for a in page.all("span") if a.get("id") == "failed"]
    assert "unexpected contact of 21 N" in leaf["title"]
    fates = [
        attributes["class"].split()[-1]
        for attributes in page.all("span")
        if "node" in attributes.get("class", "")
    ]
    assert fates[:6] == ["failure", "success", "success", "success", "failure", "waiting"]


@pytest.mark.parametrize(
    ("held", "headline"),
    [
        (None, "Stopped safely"),
        (HeldObject("cup", "put down"), "Stopped safely"),
        (HeldObject("cup", "held"), "Stopped: the hand still holds 'cup'"),
        (HeldObject("cup", "lost"), "Stopped: the hand lost 'cup'"),
        (HeldObject(None, "held"), "Stopped: the hand still holds what was grasped"),
    ],
)
def test_the_headline_says_what_became_of_what_was_held(
    data: ReportData, held: HeldObject | None, headline: str, tmp_path: Path
) -> None:
    page = page_of(stopped(data, "interrupted", held, recorded=None), tmp_path)
    assert headline in page.text
    assert "Next steps" in page.text
    advice = {
        "held": "Support 'cup', open the fingers",
        "lost": "Find 'cup'",
        "put down": "'cup' was put down",
    }
    if held is not None and held.object is not None:
        assert advice[held.became] in page.text
    assert "Keep what was measured before the stop: bottle.mass, table.height." in page.text


def test_a_disagreement_is_shown_with_the_value(data: ReportData, tmp_path: Path) -> None:
    pulled = FitTest("along the lift", 30.0, 4.2, "Something pulls on <it>.")
    mass, *others = data.run.estimates
    contradicted = replace(mass, tests=(pulled,))
    page = page_of(grown(data, estimates=(contradicted, *others)), tmp_path)
    assert "contradicted" in page.text
    assert "Something pulls on <it>." in page.text
    assert f"{len(others)} of {1 + len(others)} unknowns measured." in page.text
    page = page_of(grown(data, estimates=(mass,)), tmp_path)
    assert "1 of 2 unknowns measured." in page.text, "the plan is for two"


def test_poses_are_shown_by_sight_by_touch_and_by_both(data: ReportData, tmp_path: Path) -> None:
    seen = Belief.of(Pose.of((0.5, 0.1, 0.4)), 1e-5 * np.eye(6))
    felt = seen.update("probe", np.array([1.0, 0.0, 0.0]), np.array([0.47, 0.1, 0.4]), 0.002)
    off = seen.update("probe", np.array([1.0, 0.0, 0.0]), np.array([0.47, 0.1, 0.4]), 0.02)
    beliefs = {"<cup>": seen, "box": felt, "tin": off}
    pictured = replace(grown(data, beliefs=beliefs), pictures=Pictures(seen=SQUARE))
    page = page_of(pictured, tmp_path)
    assert [item for item in page.all("img") if "camera saw" in item["alt"]]
    assert "x 500.0 ± 3.2, y 100.0 ± 3.2" in page.text
    assert "probe: +2.0 ± 1.0 mm along +x" in page.text
    assert "x 501.8 ± 1.0" in page.text
    assert page.text.count("standard deviations: it does not stand there") == 1
    assert "; tin not where it was seen." in page.text
    assert "Where things stand" not in page_of(data, tmp_path).text


def test_a_real_robot_has_no_truth(data: ReportData, tmp_path: Path) -> None:
    page = page_of(grown(data, truth={}), tmp_path)
    assert "hidden truth" not in page.text
    assert "0.76503" in page.text


@pytest.mark.parametrize(
    ("truth", "at", "error"), [(2.0, "100.0%", "−87 %"), (0.1, "0.0%", "+1.5e+02 %")]
)
def test_a_truth_off_the_scale_stays_on_the_bar(
    data: ReportData, truth: float, at: str, error: str, tmp_path: Path
) -> None:
    page = page_of(measured(data, (data.run.estimates[0], (truth,))), tmp_path)
    (marker,) = page.all("u")
    assert marker["style"] == f"left:{at}"
    assert "outside the interval" in page.text
    assert error in page.text, "of the truth"
    interval = next(bar["style"] for bar in page.all("i") if "left" in bar.get("style", ""))
    assert interval == "left:40.0%;width:20.0%", "it stays visible"


def test_a_diff_is_coloured_within_the_line(data: ReportData, tmp_path: Path) -> None:
    page = page_of(data, tmp_path)
    kinds = [attributes["class"] for attributes in page.all("pre")]
    assert kinds.count("add") == kinds.count("del") == 2
    marked = [
        page.texts[i + 1] for i, text in enumerate(page.texts) if text.endswith('pos="0.58 0 ')
    ]
    assert marked == ["?", "0.74703"]


def test_vectors_have_a_bar_for_each_component(data: ReportData, tmp_path: Path) -> None:
    com = Estimate(
        Parameter("hammer", "com"),
        "m",
        (0.01, -0.002, 0.09),
        (0.001,) * 3,
        ((0.008, 0.012), (-0.004, 0.0), (0.088, 0.092)),
        "Torques.",
        (),
    )
    page = page_of(measured(data, (com, (0.011, -0.002, 0.2))), tmp_path)
    assert len(page.all("u")) == 3
    assert [text for text in page.texts if text in ("x", "y", "z")] == ["x", "y", "z"]


def test_large_pictures_are_scaled_and_bad_ones_left_out(data: ReportData, tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (1200, 1900, 3), dtype=np.uint8)
    pictures = Pictures(png(noise), b"not a picture", b"<svg/>")
    page = page_of(replace(data, pictures=pictures), tmp_path)
    assert [image["src"][:22] for image in page.all("img")] == ["data:image/jpeg;base64"]
    with Image.open(
        io.BytesIO(base64.b64decode(page.all("img")[0]["src"].partition(",")[2]))
    ) as image:
        assert image.width == 1280


def test_the_same_run_gives_the_same_page(data: ReportData, tmp_path: Path) -> None:
    write_report(tmp_path / "a.html", data)
    write_report(tmp_path / "b.html", data)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


def test_equal_pictures_are_described_as_equal(data: ReportData, tmp_path: Path) -> None:
    page = page_of(replace(data, pictures=Pictures(None, picture(), picture())), tmp_path)
    assert "No visible change" in page.text
    assert len(page.all("img")) == 1
    changed = Pictures(None, picture(), picture(changed=True))
    gap = page_of(replace(data, pictures=changed), tmp_path)
    assert "No visible change" not in gap.text
    assert "(6.2 % of the picture)" in gap.text


def test_many_estimates_stand_sorted_above_their_cards(data: ReportData, tmp_path: Path) -> None:
    several: list[tuple[Estimate, tuple[float, ...] | None]] = []
    for i, value in enumerate((0.2, 0.5, 0.1, 0.4)):
        estimate = Estimate.normal(Parameter(f"can{i}", "mass"), "kg", value, 0.001, "Weighed.")
        several.append((estimate, (value + 0.001,)))
    assert "on one scale" not in page_of(measured(data, *several), tmp_path).text
    lost = not_identified(Parameter("lost", "mass"), "kg", "It was never lifted.")
    page = page_of(measured(data, *several, (lost, None)), tmp_path)
    assert "on one scale" in page.text
    first = [text for text in page.texts if re.fullmatch(r"can\d|lost", text)][:5]
    assert first == ["can1", "can3", "can0", "can2", "lost"]
    assert {a["href"][1:] for a in page.all("a") if a["href"].startswith("#")} <= ids(page)


def test_a_simulated_run_says_so_and_how_to_do_it_again(data: ReportData, tmp_path: Path) -> None:
    command = "palpate demo bottle_and_table --noise lab --seed 0"
    page = page_of(replace(data, command=command), tmp_path)
    assert command in page.text
    assert "Simulated" in page.texts
    made_up = page_of(grown(data, world=DRAWN), tmp_path)
    assert "Simulated, and made up" in made_up.texts
    real = grown(data, simulated=False, settings=Settings(request="a\u202eb"))
    assert "Simulated" not in page_of(real, tmp_path).texts
    assert "\u202e" not in (tmp_path / "report.html").read_text("utf-8"), "turns the way of writing"


def test_no_key_stands_on_the_page(data: ReportData, tmp_path: Path) -> None:
    key = "sk-0123456789abcdef"
    page = source_of(stopped(data, f"401: {key}"), tmp_path)
    assert (key in page, "401: [key]" in page) == (False, True)


def source_of(data: ReportData, folder: Path) -> str:
    write_report(folder / "report.html", data)
    return (folder / "report.html").read_text(encoding="utf-8")


def test_page_of_many_objects_folds_rows_and_motions_and_begins_with_the_contents(
    data: ReportData, tmp_path: Path
) -> None:
    bodies = (f"<geom name='thing {i}' size='.1 .1 .1' type='box'/>" for i in range(6))
    many = parse_scene(f"<mujoco><worldbody>{''.join(bodies)}</worldbody></mujoco>")
    few = source_of(data, tmp_path)
    assert 'retraced" open>' in few
    assert few.index('class="estimates"') < few.index('aria-label="Contents"')
    more = source_of(grown(data, scene=many, estimates=data.run.estimates * 3), tmp_path)
    assert "6 objects and surfaces, 6 quantities" in more
    assert 'retraced" open>' not in more
    assert more.index('aria-label="Contents"') < more.index('class="estimates"')


def test_a_twin_without_a_measured_value_is_the_scene_as_it_was_given(
    data: ReportData, tmp_path: Path
) -> None:
    same = replace(complete(data), pictures=Pictures(None, picture(), picture()))
    page = page_of(grown(same, finished=replace(data.run.twin, diff="")), tmp_path)
    assert "Nothing was measured: the twin is that scene." in page.text
    assert "The user's MJCF, unchanged." in page.text


def leaf_of(path: str, status: str) -> LeafRun:
    return LeafRun(path, "MeasureForces", "MeasureForces()", 0.0, 1.0, status, "")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("statuses", "fate", "culprit"),
    [
        (("SUCCESS", "SUCCESS"), "success", None),
        (("SUCCESS",), "waiting", None),
        (("INVALID", "FAILURE"), "failure", "tree.children[1]"),
        (("SUCCESS", "INVALID"), "stopped", "tree.children[1]"),
    ],
)
def test_the_fate_of_a_composite_is_that_of_the_child_that_decides(
    data: ReportData, statuses: tuple[str, ...], fate: str, culprit: str | None
) -> None:
    """Of two leaves beside each other the failed one stops the other, whichever comes first."""
    sensing = Node("MeasureForces")
    plan = Plan((), Node("Parallel", (), (sensing, Node("MeasureForces", name="other"))), "")
    runs = [leaf_of(f"tree.children[{i}]", status) for i, status in enumerate(statuses)]
    tree = branches(plan, replace(data.run.trace, leaves=tuple(runs)))
    assert tree is not None
    assert tree.fate == fate
    failed = first_failure(tree)
    assert (None if failed is None else f"tree.children[{tree.children.index(failed)}]") == culprit


@pytest.mark.parametrize(
    ("brightness", "visible"), [(95, False), (105, False), (130, True), (70, True)]
)
def test_a_change_is_seen_beyond_the_noise_of_pictures(brightness: int, visible: bool) -> None:
    item, other = (png(np.full((8, 8, 3), level, np.uint8)) for level in (100, brightness))
    difference = change(item, other)
    assert difference is not None
    assert (difference.visible, difference.share) == (visible, float(visible))


def test_believed_values_are_in_the_table_of_measured_ones(
    data: ReportData,
) -> None:
    mass, height = data.run.estimates
    believed = replace(height, verdict="prior-dominated")
    lost = not_identified(mass.parameter, "kg", "It was never lifted.")
    groups = parameter_groups(replace(data.run, estimates=(lost, believed)))
    shown = {row.quantity: row.value for rows in groups.values() for row in rows}
    assert (shown["mass"], shown["height"]) == ("?", "? → 0.76503 m")


def test_actions_of_a_controlled_stop_are_listed_apart_from_the_plan(
    data: ReportData,
) -> None:
    stop = LeafRun("stop", "OpenGripper", "OpenGripper()", 8.0, 8.0, "SUCCESS", "open to 80 mm")
    planned = leaf_of("tree.children[0]", "SUCCESS")
    trace = replace(data.run.trace, leaves=(planned, stop))
    (done,) = list_stop_actions(data.run.plan, trace)
    assert done.label == "OpenGripper()"
    assert (done.left, done.width) == (100.0, NARROWEST)
    assert not list_stop_actions(data.run.plan, None)
