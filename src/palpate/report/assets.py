"""Assets embedded in the page: scripts, pictures, and the content policy that forbids all others."""

from __future__ import annotations

import base64
import gzip
import hashlib
import io
import re
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, cast

from palpate.display import visible

if TYPE_CHECKING:
    from jinja2 import Template
    from markupsafe import Markup

MAX_IMAGE = 400_000
"""Bytes above which pictures are scaled down to `IMAGE_WIDTH` and stored as JPEG."""
IMAGE_WIDTH = 1280
PACKING = 4
"""Compression level of plotly.js, 0 to 9; level 6 saves 4 % and takes twice as long."""


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

    return Markup((files("palpate.report") / "report.js").read_text(encoding="utf-8"))


@cache
def style() -> str:
    """Style of all pages: colours, light and dark, type, tables."""
    return (files("palpate.report") / "style.css").read_text(encoding="utf-8")


@cache
def template(package: str, name: str) -> Template:
    """Load a page's template from its package; `style.css` and `study.html` are available to all."""
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined, select_autoescape

    # Studies keep their templates in their own package.
    own, shared = PackageLoader(package, "."), PackageLoader("palpate.report", ".")
    environment = Environment(
        loader=ChoiceLoader([own, shared]),
        autoescape=select_autoescape(),
        undefined=StrictUndefined,
        finalize=escaped_controls,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    filters: dict[str, Any] = cast(Any, environment).filters
    filters["code"] = mark_code
    return environment.get_template(name)


def mark_code(text: str) -> Markup:
    """Escape a text, and set its parts in backticks as code."""
    from markupsafe import Markup, escape

    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def escaped_controls(value: Any) -> Any:
    """Text and markup with control characters made visible, such as those that reverse the direction
    of writing."""
    if isinstance(value, int | float):
        return value
    text = visible(str(value))
    return type(value)(text) if hasattr(value, "__html__") else text


def policy() -> str:
    """Content security policy: only the page's own scripts run, and nothing is ever fetched."""
    # The hashes allow exactly these two scripts; a page may quote text from files and models.
    own, plots = sha256_source(script().encode()), plotly()[1]
    return (
        "default-src 'none'; img-src data: blob:; media-src data:; "
        f"style-src 'unsafe-inline'; script-src {own} {plots}"
    )


def sha256_source(content: bytes) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(content).digest()).decode()}'"


def video_uri(mp4: bytes | None) -> str | None:
    """A film as a data URI."""
    return data_uri("video/mp4", mp4) if mp4 else None


def picture_uri(picture: bytes | None) -> str | None:
    """A picture as a data URI; None when there is none or it cannot be read."""
    from PIL import Image

    if not picture:
        return None
    try:
        with Image.open(io.BytesIO(picture), formats=("PNG", "JPEG")) as image:
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
