"""Draw demo.webp, the README's animation: `palpate demo` as its camera saw it, with each number from
the moment it is known. Run it from the root of the repository: python docs/images/demo.py"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from palpate.estimation.estimate import round_to_std
from palpate.perception.renderer import Painter, Pixels, framing
from palpate.runs import pipeline, planning
from palpate.runs.run import Run
from palpate.studies.scenarios.catalogue import FIRST, scenario
from palpate.trace.recording import LeafRun

FILE = Path(__file__).with_suffix(".webp")
SIZE = (720, 400)
FPS = 10.0
SPEED, DESCENT_SPEED = 3.5, 9.0
"""The film runs so many times faster than robot time; the slow descent faster still."""
HOLD = 3.5
"""s: the last picture stays, with the result."""
IN_VIEW = np.array([[0.0, -0.15, 0.62], [0.72, 0.70, 1.38]])
"""m, opposite corners: arm, bottle and table top; at the right room for the text."""
INK, DIM, FOUND = (20, 26, 32), (96, 106, 116), (0, 112, 100)
LEFT = 424
"""Pixels: where the text begins."""
ASKED = {"table height": "table.height", "bottle mass": "bottle.mass"}
"""The two unknowns, as the text calls them."""


def main() -> None:
    """Run the scenario and write the animation."""
    settings = scenario(FIRST).settings(seed=0, fast=True)
    run = pipeline.measure(planning.plan(settings, planning.load(settings)))
    first, *others = [Image.fromarray(pixels) for pixels in _frames(run)]
    times = [1000 / FPS] * len(others) + [HOLD * 1000]
    times = [round(time) for time in times]
    first.save(FILE, save_all=True, append_images=others, duration=times, quality=70, method=6)
    print(f"{FILE}: {FILE.stat().st_size / 1e6:.2f} MB, {sum(times) / 1000:.1f} s")


def _frames(run: Run) -> Iterator[Pixels]:
    assert run.footage is not None
    assert run.trace is not None
    t, qpos = map(np.array, zip(*run.footage.frames, strict=True))
    model = run.footage.drawn()
    data = mujoco.MjData(model)
    with Painter(model, *SIZE) as painter:
        camera = framing(IN_VIEW, aspect=painter.aspect, fovy=float(model.vis.global_.fovy))
        for now in [*_moments(run.trace.leaves, float(t[-1])), np.inf]:
            data.qpos[:] = qpos[min(int(np.searchsorted(t, now)), len(t) - 1)]
            mujoco.mj_forward(model, data)
            yield _captioned(painter.paint(data, camera), run, now)


def _moments(leaves: Sequence[LeafRun], end: float) -> Iterator[float]:
    """Robot times of the frames."""
    now = 0.0
    while now < end:
        yield now
        descends = any(_runs(leaf, now) and leaf.primitive == "MoveUntilContact" for leaf in leaves)
        now += (DESCENT_SPEED if descends else SPEED) / FPS


def _captioned(pixels: Pixels, run: Run, now: float) -> Pixels:
    """The picture with the two unknowns, known or not yet, and what the arm does."""
    picture = Image.fromarray(pixels)
    draw = ImageDraw.Draw(picture, "RGBA")
    draw.rounded_rectangle((LEFT - 14, 16, SIZE[0] - 16, 186), 8, fill=(255, 255, 255, 225))
    for row, (name, parameter) in enumerate(ASKED.items()):
        top = 26 + 78 * row
        value, truth = _known(run, name, parameter, now)
        draw.text((LEFT, top), name, DIM, _font(15))
        draw.text((LEFT, top + 18), value, INK if value == "?" else FOUND, _font(27))
        draw.text((LEFT, top + 51), truth, DIM, _font(14))
    doing = [leaf.label for leaf in run.trace.leaves if _runs(leaf, now)] if run.trace else []
    draw.rectangle((0, SIZE[1] - 30, *SIZE), fill=(15, 20, 26, 190))
    draw.text((14, SIZE[1] - 24), " ".join(doing) or "palpate demo", (240, 244, 248), _font(15))
    return np.asarray(picture)


def _known(run: Run, name: str, parameter: str, now: float) -> tuple[str, str]:
    """The value that is known at robot time `now`; in the end the final one, and the truth."""
    assert run.trace is not None
    if np.isinf(now):
        found = next(e for e in run.estimates if str(e.parameter) == parameter)
        value = " ± ".join(round_to_std(found.values[0], found.stds[0]))
        truth = f"truth {run.truth[found.parameter][0]:g} {found.unit}, looked up last"
        return f"{value} {found.unit}", truth
    for leaf in run.trace.leaves:
        if leaf.end <= now and leaf.message.startswith(name):
            return leaf.message.removeprefix(name).strip(), ""
    return "?", ""


def _runs(leaf: LeafRun, now: float) -> bool:
    return leaf.start <= now < leaf.end


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size=size)


if __name__ == "__main__":
    main()
