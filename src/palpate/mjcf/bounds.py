"""Bounds on the size of a scene, computed from its text and its files before MuJoCo builds it.

A line of MJCF can request a million bodies, and a small picture can unpack to gigabytes. The limits are
about ten times the needs of workplace scenes. With MuJoCo 4.0 on one core, the worst scene within them
compiles in half a minute and 2 GB, nearly all of it for meshes. The worst scene without meshes takes about
a second.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from math import inf, prod
from pathlib import Path
from typing import BinaryIO

from palpate.common.errors import InputError
from palpate.common.files import open_with_limit, read_bytes
from palpate.mjcf.document import (
    ATTACH,
    MAX_ASSET_BYTES,
    Document,
    Element,
    elements,
    find_attached,
    label,
    tokens,
)

ELEMENTS, REPLICATED, COPIES = "elements", "replicated elements", "elements with all their copies"
POINTS, CELLS = "points of flexible bodies", "cells of height fields"
PIXELS, MESHES = "pixels of textures", "bytes of meshes"
# Largest amounts in a scene.
LIMITS: Mapping[str, int] = {
    ELEMENTS: 10_000,  # a kitchen with its furniture cut into convex pieces has about five thousand
    REPLICATED: 3_000,  # MuJoCo's time for them grows with the square of their number
    COPIES: 50_000,  # those by `<attach>` are cheap: 2 s
    POINTS: 4_000,
    CELLS: 4_000_000,
    PIXELS: 64_000_000,
    MESHES: 30_000_000,  # each MB takes at most 0.9 s and 60 MB of memory, once hulls are bounded
}
# Total bytes of meshes from which their hulls are bounded. qhull needs 0.2 s for the worst mesh of
# 0.1 MB, but a minute for one of 2 MB: its time grows with the square of the points.
LARGE_MESHES = 250_000
HULL_POINTS = 2_000  # Largest number of points of each bounded hull (MuJoCo's `maxhullvert`)
MAX_MEMORY = 512 << 20  # Bytes that `<size memory=…>` may reserve
MAX_UNPACKED = 300_000_000  # Bytes to which one picture may unpack
# Attributes that set a size, and the largest number in each.
SIZES: Mapping[str, float] = {
    **dict.fromkeys(("actdim", "dim", "gridlayout", "interval", "nkey", "num"), 1_000),
    **dict.fromkeys(("numquads", "numslices", "numstacks"), 1_000),
    **dict.fromkeys(("nuser_body", "nuser_jnt", "nuser_geom", "nuser_site"), 1_000),
    **dict.fromkeys(("nuser_cam", "nuser_tendon", "nuser_actuator", "nuser_sensor"), 1_000),
    **dict.fromkeys(("sdf_iterations", "sdf_initpoints"), 1_000),
    **dict.fromkeys(("iterations", "ls_iterations", "noslip_iterations"), 10_000),
    **dict.fromkeys(("ccd_iterations", "nsample"), 10_000),
    **dict.fromkeys(("nconmax", "njmax", "nuserdata"), 100_000),
    **dict.fromkeys(("offheight", "offwidth", "resolution", "shadowsize"), 16_384),
    "nstack": 50_000_000,
    "octree_maxdepth": 8,
    "offsamples": 64,
    "params": 128,
}
PNG = b"\x89PNG\r\n\x1a\n"
# Chunks with deflated content (PNG specification, 3rd edition, section 11).
_PACKED = (b"IDAT", b"zTXt", b"iTXt", b"iCCP")
# Largest number of bytes from one byte of deflated data (zlib's Technical Details).
_DEFLATE_RATIO = 1032
_UNITS = {"": 1, "k": 1 << 10, "m": 1 << 20, "g": 1 << 30, "t": 1 << 40, "p": 1 << 50, "e": 1 << 60}
# Bytes per point in a binary mesh file: a triangle of an STL has 50 for three points.
_POINT_BYTES = 16
_SDF_BYTES = 1_000_000  # Equivalent file size of a mesh made by an SDF plugin, which takes 0.5 s
# Elements that MuJoCo gets; those that are removed with a robot are left out.
ElementSet = Collection[Element]
# Prefix of MuJoCo's own plugins; other plugins would have to be loaded as code.
_BUILT_IN = "mujoco."


def require_limits(
    document: Document, where: str = "the scene", loaded: ElementSet | None = None
) -> None:
    """Check the size of a scene, with the models that it attaches and its `loaded` assets, by default all.

    Raises:
        InputError: an amount beyond its limit, a picture that unpacks to too many bytes, or a plugin
            that is not MuJoCo's own. The message names the element or the file.
    """
    for model in (document, *document.attached().values()):
        for element in elements(model.root):
            _require_sizes(element, where)
    # Amounts in files, then those of every element with its copies.
    files = _file_amounts(document, loaded)
    total: defaultdict[str, float] = defaultdict(float)
    # Amounts are summed during the walk and refused at the first excess, so that a bomb is never walked to
    # its end.
    for element, own, copies in _copies(document):
        # An `<attach>` copies the assets of its model once, even inside a `<replicate>`.
        amounts = [(ELEMENTS, own), (REPLICATED, max(own - 1.0, 0.0)), (COPIES, copies)]
        counted = _amounts(element) if loaded is None or element in loaded else ()
        for what, amount in (*counted, *files.get(element, ())):
            amounts.append((what, amount * (copies if what == POINTS else 1.0)))
        for what, amount in amounts:
            total[what] += amount
            if total[what] > LIMITS[what]:
                raise InputError(
                    f"{where}: with {label(element)} the scene has more than {LIMITS[what]} {what}; use fewer"
                )


def has_large_textures(document: Document, loaded: ElementSet) -> bool:
    """Test if textures have too many pixels in total, or unpack to more bytes than allowed."""
    try:
        require_limits(document, loaded={element for element in loaded if element.tag == "texture"})
    except InputError:
        return True
    return False


def mesh_bytes(document: Document, loaded: ElementSet) -> float:
    """Sum the bytes of the loaded meshes of a scene and its attached models, in files and in the text."""
    total = 0.0
    for named in document.named:
        if named.element.tag == "mesh" and named.element in loaded:
            total += named.path.stat().st_size
    for mesh in loaded:
        if mesh.tag == "mesh":
            total += sum(amount for what, amount in _amounts(mesh) if what == MESHES)
    return total


def _copies(document: Document) -> Iterator[tuple[Element, float, float]]:
    """Yield every element with the number of its copies in its own model and in the scene."""
    # The former is 0 after the first visit of a model. Each `<attach>` visits its model, which is
    # visited at least once.
    seen: set[Document] = set()
    for start in (document, *document.attached().values()):
        pending = [] if start in seen else [(start.root, start, 1.0, 1.0)]
        seen.add(start)
        while pending:
            element, model, own, copies = pending.pop()
            yield element, own, copies
            if element.tag == "replicate":
                # A `<replicate>` multiplies its content.
                count = max([1.0, *_numbers(element, "count")])
                own, copies = own * count, copies * count
            if element.tag == ATTACH and (part := find_attached(element, model, ())) is not None:
                # An `<attach>` visits the content of its model.
                copied = part.content if part.is_own else part.model.root
                pending.append((copied, part.model, float(part.model not in seen), copies))
                seen.add(part.model)
            for child in reversed(element):
                if isinstance(child.tag, str):
                    pending.append((child, model, own, copies))


def _amounts(element: Element) -> Iterator[tuple[str, float]]:
    """Yield the amounts that one copy of an element adds to the scene, without its files."""
    match element.tag:
        case "flexcomp":
            # MuJoCo's own count where none is stated; trilinear cells have a point at each corner.
            if element.get("file") is None:
                yield POINTS, _weight(element) * prod(_numbers(element, "count") or (10.0,) * 3)
            yield POINTS, prod(cells + 1.0 for cells in _numbers(element, "cellcount")) - 1.0
            yield POINTS, _weight(element) * len(tokens(element.get("point"))) / 3
        case "flex":
            yield POINTS, len(tokens(element.get("vertex"))) / 3
        case "hfield":
            yield CELLS, _product(element, "nrow", "ncol")
        case "config" if element.get("key") == "size":  # of a grid of touch sensors
            yield CELLS, prod(_numbers(element, "value"))
        case "texture" if element.get("builtin"):
            sides = 1 if element.get("type") == "2d" else 6
            yield PIXELS, sides * _product(element, "width", "height")
        case "mesh":
            grid = max([0.0, *_numbers(element, "params")]) if element.get("builtin") else 0.0
            is_sdf = element.find("plugin") is not None
            yield MESHES, 24 * grid**2 + is_sdf * _SDF_BYTES
            yield MESHES, len(element.get("vertex") or "")
        case _:
            pass


def _file_amounts(
    document: Document, loaded: ElementSet | None
) -> dict[Element, list[tuple[str, float]]]:
    """Compute the amounts that the files of each loaded element add: pixels of PNG pictures, other files' bytes."""
    amounts_of: dict[Element, list[tuple[str, float]]] = {}
    pixels: dict[Path, int] = {}
    for named in document.named:
        is_counted = loaded is None or named.element in loaded
        if named.element.tag in ("include", "model") or not is_counted:
            continue
        # A picture adds its pixels, another file its bytes.
        path, amounts = named.path, amounts_of.setdefault(named.element, [])
        if path not in pixels:
            pixels[path] = _picture_pixels(path)
        if pixels[path]:
            amounts.append((PIXELS, pixels[path]))
            continue
        amounts.append((MESHES, path.stat().st_size))
        if named.element.tag == "flexcomp":
            # Points of a flexible body: by the file's size, or by the lines of an OBJ.
            points = path.stat().st_size / _POINT_BYTES
            if path.suffix.lower() == ".obj":
                content = read_bytes(path, LIMITS[MESHES], "points of a flexible body")
                points = len(re.findall(rb"(?m)^[ \t]*v[ \t]", content))
            amounts.append((POINTS, _weight(named.element) * points))
    return amounts_of


def _weight(flexcomp: Element) -> float:
    """Return the weight of a point: 0.1 for points of a rigid flexcomp, which is a single body, else 1."""
    return 0.1 if flexcomp.get("rigid") == "true" else 1.0


def _picture_pixels(path: Path) -> int:
    """Return the number of pixels of a PNG picture with a valid unpacked size; 0 for other files."""
    with open_with_limit(path, MAX_ASSET_BYTES, "a file that a scene may name") as file:
        # Width and height are in the header of the first chunk.
        start = file.read(24)
        if not start.startswith(PNG) or len(start) < 24:
            return 0
        width, height = struct.unpack(">II", start[16:24])
        if width * height > LIMITS[PIXELS]:
            raise InputError(
                f"{path} has {width} × {height} pixels; at most {LIMITS[PIXELS] // 1_000_000} "
                "million are read"
            )
        # A small file cannot unpack to a large one, and needs no check.
        if path.stat().st_size * _DEFLATE_RATIO > MAX_UNPACKED:
            _check_unpacked_size(path, file)
    return width * height


def _check_unpacked_size(path: Path, file: BinaryIO) -> None:
    """Unpack a picture in pieces up to the limit, with little memory."""
    # Only image data is unpacked; other chunks count with their worst ratio.
    unpacked = 0
    stream = zlib.decompressobj()
    for kind, content in _iter_chunks(file):
        if kind != b"IDAT":  # text and colour profile: the worst case
            unpacked += len(content) * _DEFLATE_RATIO
        elif not stream.eof:
            try:
                unpacked += len(stream.decompress(content))
            except zlib.error:  # MuJoCo reports the error
                return
        if unpacked > MAX_UNPACKED:
            raise InputError(
                f"{path} unpacks to more than {MAX_UNPACKED // 1_000_000} MB; use a smaller picture"
            )


def _iter_chunks(file: BinaryIO) -> Iterator[tuple[bytes, bytes]]:
    """Yield kind and content of the deflated chunks, in pieces of 64 kB."""
    file.seek(len(PNG))
    while len(head := file.read(8)) == 8:
        length, kind = struct.unpack(">I4s", head)
        if kind not in _PACKED:  # skip the chunk and its checksum
            file.seek(length + 4, 1)
            continue
        while length > 0 and (content := file.read(min(length, 1 << 16))):
            length -= len(content)
            yield kind, content
        file.seek(4, 1)


def _require_sizes(element: Element, where: str) -> None:
    """Require sizing attributes within `SIZES`, and plugins of MuJoCo alone."""
    # Numbers that set MuJoCo's memory or computing time.
    for attribute in SIZES.keys() & set(element.keys()):
        if max(_numbers(element, attribute), default=0.0) > SIZES[attribute]:
            raise _limit_error(element, where, attribute, SIZES[attribute])
    if element.tag == "size" and _memory(element) > MAX_MEMORY:
        raise _limit_error(element, where, "memory", f"{MAX_MEMORY >> 20}M")
    plugin = element.get("plugin")
    if plugin is not None and not plugin.startswith(_BUILT_IN):
        raise InputError(
            f"{where}: {label(element)} needs the plugin '{plugin[:60]}', which is foreign code; "
            f"only MuJoCo's own plugins ('{_BUILT_IN}…') are loaded: remove it"
        )


def _limit_error(element: Element, where: str, attribute: str, limit: object) -> InputError:
    value = (element.get(attribute) or "")[:40]
    return InputError(
        f'{where}: {label(element)}: {attribute}="{value}" is too large; at most {limit}'
    )


def _numbers(element: Element, attribute: str) -> Sequence[float]:
    """Return the absolute values of an attribute's numbers, with nan as inf; MuJoCo refuses other texts."""
    numbers: list[float] = []
    for part in tokens(element.get(attribute)):
        try:
            number = abs(float(part))
        except ValueError:
            continue
        numbers.append(inf if number != number else number)
    return numbers


def _product(element: Element, *attributes: str) -> float:
    return prod(max([0.0, *_numbers(element, attribute)]) for attribute in attributes)


def _memory(element: Element) -> float:
    """Return the bytes of a `memory`, with MuJoCo's suffix for kilo- to exabytes (powers of 1024)."""
    match = re.fullmatch(r"\s*([\d.eE+]+)\s*([a-zA-Z]?)\s*", element.get("memory") or "")
    if match is None:
        return 0.0
    try:
        return float(match.group(1)) * _UNITS.get(match.group(2).lower(), inf)
    except ValueError:
        return 0.0
