"""The report: one HTML page that holds everything and asks nothing of the network."""

from __future__ import annotations

import base64
import gzip
import hashlib
import io
import re
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.report.data import Measured, ParameterRow, ReportData
from palpate.report.diff import diff_lines
from palpate.report.plots import FAILED, GROUPS, timeline
from palpate.report.view import (
    aftermath,
    branches,
    cards,
    in_words,
    parameter_groups,
    primitive_groups,
    windows,
)

if TYPE_CHECKING:
    from jinja2 import Template
    from markupsafe import Markup

__all__ = ["Measured", "ParameterRow", "ReportData", "write_report"]

MAX_IMAGE = 400_000
"""Bytes: larger pictures are scaled down to `IMAGE_WIDTH` and stored as JPEG."""
IMAGE_WIDTH = 1280

VERDICTS = {
    "complete": "Complete",
    "rejected": "Not measured",
    "aborted": "Stopped safely",
    "failed": "Incomplete",
}


def write_report(path: Path, data: ReportData) -> None:
    """Write the page to `path`."""
    path.write_text(render_report(data), encoding="utf-8")


def render_report(data: ReportData) -> str:
    """The page's HTML."""
    estimates = [m.estimate for m in data.measured]
    named = windows(data.trace, estimates) if data.trace else {}
    groups = primitive_groups()
    figure = timeline(data.trace, named, groups) if data.trace and len(data.trace.samples) else None
    return _template().render(
        data=data,
        verdict=VERDICTS[data.status],
        verdict_line=_verdict_line(data),
        cards=cards(data.measured, data.trace),
        captions=in_words(data.measured),
        parameters=parameter_groups(data.parameters, data.measured),
        tree=branches(data.plan, data.trace),
        aftermath=aftermath(data.plan, data.trace),
        figure=figure,
        group_colours=GROUPS,
        failed=FAILED,
        actions=_actions(data),
        diff=diff_lines(data.twin_diff),
        script=_script(),
        plotly=_plotly()[0] if figure else "",
        policy=_policy(),
        pictures={
            name: _data_uri(getattr(data, name)) for name in ("workspace", "before", "after")
        },
        video=_uri("video/mp4", data.video) if data.video else None,
        files=[
            name
            for name in data.files
            if re.fullmatch(r"[\w.-]+(/[\w.-]+)*", name) and ".." not in name
        ],
    )


def _verdict_line(data: ReportData) -> str:
    """The run in one sentence."""
    found = sum(m.estimate.verdict != "not identified" for m in data.measured)
    wanted = max(len(data.plan.parameters), len(data.measured))
    if data.status == "rejected":
        return "The arm did not move."
    if data.plan.satisfied:
        return "Nothing is missing: the arm did not move."
    if data.status == "aborted":
        return data.stopped_by or "The robot stopped before the plan was finished."
    return f"{found} of {wanted} unknown{'s' if wanted != 1 else ''} measured."


def _actions(data: ReportData) -> int:
    return sum(not node.children for _, node in data.plan.tree.walk()) if data.plan.tree else 0


@cache
def _template() -> Template:
    from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

    environment = Environment(
        loader=PackageLoader("palpate.report", "."),
        autoescape=select_autoescape(),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("template.html")


@cache
def _plotly() -> tuple[Markup, str]:
    """plotly.js, gzipped and in base64 (a third of its size), and the hash of its text for the
    page's policy."""
    from markupsafe import Markup

    source = (files("plotly") / "package_data" / "plotly.min.js").read_bytes()
    packed = base64.b64encode(gzip.compress(source, 9, mtime=0)).decode()
    return Markup(packed), _sha256(source)


@cache
def _script() -> Markup:
    from markupsafe import Markup

    return Markup((files("palpate.report") / "report.js").read_text(encoding="utf-8"))


def _sha256(content: bytes) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(content).digest()).decode()}'"


def _policy() -> str:
    """Content security policy: only the page's own scripts run, and nothing is ever fetched."""
    scripts = f"{_sha256(_script().encode())} {_plotly()[1]}"
    return f"default-src 'none'; img-src data: blob:; media-src data:; style-src 'unsafe-inline'; script-src {scripts}"


def _uri(mime: str, content: bytes) -> str:
    return f"data:{mime};base64,{base64.b64encode(content).decode()}"


def _data_uri(picture: bytes | None) -> str | None:
    """A picture as a data URI; None when there is none or it cannot be read."""
    from PIL import Image

    if not picture:
        return None
    try:
        with Image.open(io.BytesIO(picture), formats=("PNG", "JPEG")) as image:
            if len(picture) <= MAX_IMAGE:
                return _uri(f"image/{(image.format or 'png').lower()}", picture)
            return _uri("image/jpeg", _scaled(image))
    except (OSError, ValueError, Image.DecompressionBombError):
        return None


def _scaled(image: Any) -> bytes:
    image = image.convert("RGB")
    image.thumbnail((IMAGE_WIDTH, IMAGE_WIDTH))
    buffer = io.BytesIO()
    image.save(buffer, "JPEG", quality=86)
    return buffer.getvalue()
