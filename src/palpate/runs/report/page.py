"""The report: one self-contained HTML page, and its embedded assets."""

from __future__ import annotations

import base64
import gzip
import hashlib
import io
import re
from collections.abc import Iterator
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from palpate.common.display import visible
from palpate.common.redaction import redact
from palpate.common.version import __version__
from palpate.primitives.registry import vocabulary
from palpate.robots.simulated.noise.models import noise_models
from palpate.runs.answer import answer
from palpate.runs.report import sections
from palpate.runs.report.cards import FEW, cards, forest, in_words, parameter_groups
from palpate.runs.report.changes import change, diff_lines, windows
from palpate.runs.report.data import Pictures, ReportData, twin_checks
from palpate.runs.report.plots import FAILED, GROUPS, timeline
from palpate.runs.report.sections import Branch

if TYPE_CHECKING:
    from jinja2 import Template
    from markupsafe import Markup

    from palpate.runs.run import Run


# Libraries whose versions the page states.
LIBRARIES = ("mujoco", "mink", "py_trees", "numpy", "scipy")
MAX_IMAGE = 400_000  # Bytes: larger pictures are scaled down to `IMAGE_WIDTH` and stored as JPEG
IMAGE_WIDTH = 1280
PACKING = 4  # Compression level of plotly.js, 0 to 9. Level 6 saves 4 % and takes twice as long.


@cache
def plotly() -> tuple[Markup, str]:
    """plotly.js, gzipped and in base64, and the hash of its text for the page's policy."""
    from markupsafe import Markup

    source = (files("plotly") / "package_data" / "plotly.min.js").read_bytes()
    packed = base64.b64encode(gzip.compress(source, PACKING, mtime=0)).decode()
    return Markup(packed), sha256_source(source)


@cache
def script() -> Markup:
    """The page's own script."""
    from markupsafe import Markup

    return Markup((files("palpate.runs.report") / "report.js").read_text(encoding="utf-8"))


@cache
def style() -> str:
    """Style of all pages: colours, light and dark, type, tables."""
    return (files("palpate.runs.report") / "style.css").read_text(encoding="utf-8")


@cache
def template(package: str, name: str) -> Template:
    """Load a page's template from its package; `style.css` and `study.html` are available to all."""
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined, select_autoescape

    # Studies keep their templates in their own package.
    own, shared = PackageLoader(package, "."), PackageLoader("palpate.runs.report", ".")
    environment = Environment(
        loader=ChoiceLoader([own, shared]),
        autoescape=select_autoescape(),
        undefined=StrictUndefined,
        finalize=escape_controls,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    filters: dict[str, Any] = cast(Any, environment).filters
    filters["code"] = mark_code
    return environment.get_template(name)


def mark_code(text: str) -> Markup:
    """Escape a text, and mark its parts in backticks as code."""
    from markupsafe import Markup, escape

    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def escape_controls(value: Any) -> Any:
    """Make control characters in text and markup visible, such as those that reverse the direction of writing."""
    if isinstance(value, int | float):
        return value
    text = visible(str(value))
    return type(value)(text) if hasattr(value, "__html__") else text


def policy() -> str:
    """Content security policy: only the page's own scripts run, and the page fetches nothing."""
    # The hashes allow exactly these two scripts: a page may quote text from files and models.
    own, plots = sha256_source(script().encode()), plotly()[1]
    return (
        "default-src 'none'; img-src data: blob:; media-src data:; "
        f"style-src 'unsafe-inline'; script-src {own} {plots}"
    )


def sha256_source(content: bytes) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(content).digest()).decode()}'"


def picture_uri(picture: bytes | None) -> str | None:
    """Encode a picture as a data URI; None if there is none or it cannot be read."""
    from PIL import Image

    if not picture:
        return None
    try:
        with Image.open(io.BytesIO(picture), formats=("PNG", "JPEG")) as image:
            # Keep small pictures; scale large ones down.
            if len(picture) <= MAX_IMAGE:
                return data_uri(f"image/{(image.format or 'png').lower()}", picture)
            scaled, buffer = image.convert("RGB"), io.BytesIO()
            scaled.thumbnail((IMAGE_WIDTH, IMAGE_WIDTH))
            scaled.save(buffer, "JPEG", quality=86)
            return data_uri("image/jpeg", buffer.getvalue())
    except (OSError, ValueError, Image.DecompressionBombError):
        return None


def data_uri(mime: str, content: bytes) -> str:
    return f"data:{mime};base64,{base64.b64encode(content).decode()}"


# The report page, which loads nothing from the network.

VERDICTS = {
    "running": "Under way",
    "complete": "Complete",
    "rejected": "Not measured",
    "aborted": "Stopped safely",
    "failed": "Incomplete",
}

# Link targets: files in the page's folder, without a scheme.
SAFE_PATH = re.compile(r"[\w.-]+(/[\w.-]+)*")

# Advice after a failure, by the group of the failed primitive.
ADVICE = {
    "motion": "See what the hand met or what is in its way. Correct the position and size of that thing in the "
    "scene, or move it aside.",
    "gripper": "Compare the object's position, yaw and size in the scene with the real object: the fingers close "
    "where the scene has it. A `grasps` entry in poses.yaml chooses another place to grip it.",
    "sensing": "See that nothing but the plan's objects touches the arm or what it holds, and that the robot is "
    "still connected.",
    "conversion": "See that nothing but the plan's objects touched the arm or what it held: what was recorded "
    "does not suffice for a value.",
}


def write_report(path: Path, data: ReportData) -> None:
    """Write the page to `path`."""
    path.write_text(redact(render_report(data)), encoding="utf-8")


def render_report(data: ReportData) -> str:
    """Render the page's HTML."""
    run, trace, twin, done = data.run, data.run.trace_if_any, data.run.finished, data.run.execution
    # Prepare cards, tree and first failure, which several sections use.
    cells = cards(run)
    tree = sections.branches(run.plan, trace)
    failure = sections.first_failure(tree)
    poses = list(sections.pose_rows(run.beliefs))
    # Leaves of a controlled stop are outside of the tree: their paths have another prefix.
    begun: int | None = None
    if run.status == "aborted" and trace is not None:
        begun = sum(leaf.node.startswith("tree") for leaf in trace.leaves)
    checks = None if twin is None else twin.validation
    return template("palpate.runs.report", "template.html").render(
        data=data,
        run=run,
        trace=trace,
        answer=answer(run),
        noise=None if run.is_recorded else noise_models().title(run.settings.noise),
        world=run.world or "nothing was moved",
        versions={"palpate": __version__, **{name: version(name) for name in LIBRARIES}},
        verdict=verdict_title(run),
        verdict_line=verdict_sentence(run),
        actions=run.plan.actions,
        begun=begun,
        robot_seconds=None if done is None else done.robot_seconds,
        cards=cells,
        forest=forest(cells),
        FEW=FEW,
        retraced=any(card.evidence or card.charts for card in cells),
        captions=in_words(cells),
        parameters=parameter_groups(run),
        poses=poses,
        tree=tree,
        failure=failure,
        steps=tuple(next_steps(run, failure)),
        aftermath=sections.list_stop_actions(run.plan, trace),
        predictions=sections.predictions(run.held_out),
        tasks=sections.lines(data.proof),
        indifferent=tuple(sections.iter_insensitive_tasks(data.proof)),
        diff=diff_lines("" if twin is None else twin.diff),
        twin_checks={} if checks is None else twin_checks(checks),
        twin_notes=() if twin is None else twin.notes,
        files=[name for name in data.files if SAFE_PATH.fullmatch(name) and ".." not in name],
        group_colours=GROUPS,
        failed=FAILED,
        policy=policy(),
        script=script(),
        film=data.pictures.film,
        **picture_uris(data.pictures),
        **timeline_figure(run),
    )


def verdict_title(run: Run) -> str:
    """Headline of the page."""
    carried = None if run.execution is None else run.execution.held
    if run.status == "aborted" and carried is not None and carried.became != "put down":
        return f"Stopped: the hand {'still holds' if carried.became == 'held' else 'lost'} {carried.name}"
    return VERDICTS[run.status]


def verdict_sentence(run: Run) -> str:
    """Summary of the run in one sentence."""
    if run.status == "rejected":
        return "The arm did not move."
    if run.plan.satisfied:
        return "Nothing is missing: the arm did not move."
    if run.status == "aborted":
        return run.reason or "The robot stopped before the plan was finished."
    # Count the identified estimates, and name axes and objects that are doubtful.
    count = sum(estimate.identified for estimate in run.estimates)
    wanted = max(len(run.plan.parameters), len(run.estimates))
    unknowns = "unknown" if wanted == 1 else "unknowns"
    blind = [
        f"{estimate.parameter} along {' and '.join(estimate.doubtful_axes)}"
        for estimate in run.estimates
        if estimate.identified and estimate.reason
    ]
    but = f", but for {', '.join(blind)}" if blind else ""
    elsewhere = [name for name, belief in run.beliefs.items() if belief.contradiction]
    not_there = f"; {', '.join(elsewhere)} not where it was seen" if elsewhere else ""
    return f"{count} of {wanted} {unknowns} measured{but}{not_there}."


def picture_uris(pictures: Pictures) -> dict[str, Any]:
    # Mark the visible change between the pictures before and after.
    changed, film = change(pictures.before, pictures.after), pictures.film
    return {
        "workspace": picture_uri(pictures.workspace),
        "before": picture_uri(pictures.before),
        "after": picture_uri(pictures.after),
        "seen": picture_uri(pictures.seen),
        "changed": changed,
        "marked": picture_uri(changed.marked) if changed else None,
        "video": data_uri("video/mp4", film.mp4) if film else None,
    }


def timeline_figure(run: Run) -> dict[str, Any]:
    """Timeline, and plotly.js to draw it, if anything was executed."""
    trace = run.trace_if_any
    if trace is None or not len(trace.samples):
        return {"figure": None, "plotly": ""}
    # 2 MB, only for pages that draw something.
    groups = {name: primitive.group for name, primitive in vocabulary().primitives.items()}
    figure = timeline(trace, windows(trace, run.estimates), groups)
    return {"figure": figure, "plotly": plotly()[0]}


def next_steps(run: Run, failure: Branch | None) -> Iterator[str]:
    """Yield advice to the user, in order, after a run that stopped early."""
    if run.status != "aborted":
        return
    # First the object in the hand, then the failure, then the next run.
    carried = None if run.execution is None else run.execution.held
    if carried is not None:
        name = carried.name
        advice = {
            "held": f"Support {name}, open the fingers, and put it back where the scene has it.",
            "lost": f"Find {name} and put it back where the scene has it.",
        }
        put_down = f"{name} was put down: see that it stands where the scene has it."
        yield advice.get(carried.became, put_down)
    failed = failure is not None and failure.fate == "failure"
    if failure is not None and failed:
        yield ADVICE.get(failure.group, ADVICE["motion"])
    kept = [str(estimate.parameter) for estimate in run.estimates if estimate.identified]
    if kept:
        yield f"Keep what was measured before the stop: {', '.join(kept)}."
    again = "Run the command again; it is at the end of this page, under “Reproduce”."
    if failed:
        again += (
            " With `--on-failure skip` it leaves out the object that fails and measures the rest; with "
            "`--on-failure replan` it tries again from where things stand."
        )
    yield again
