"""The two pictures of the scenario `synthetic_and_real`: a plain rendering, and one with the appearance
of a photo.

`python -m bench.pictures` renders them again.
"""

from __future__ import annotations

import io
import re

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFilter

from palpate.perception.renderer import Painter, Pixels
from palpate.studies.scenarios.catalogue import ROOT

WORLD = ROOT / "synthetic_and_real" / "world.xml"
WIDTH, HEIGHT = 800, 600
FILES = ("rendering/rendering.jpg", "photo.jpg")
"""Paths relative to the scenario's folder."""

CAMERA = mujoco.MjvCamera()
"""Camera of the photo: on the arm's other side, lower and nearer than the scene's own."""
CAMERA.lookat[:] = 0.46, -0.02, 0.05
CAMERA.distance, CAMERA.azimuth, CAMERA.elevation = 1.05, -128.0, -24.0

LAMPS, LAMP_RADIUS = 6, 0.10
"""Number of averaged pictures, and the largest shift of the lamp in each, m: soft shadows."""
LIGHTS = """
<light pos="0.1 0.9 1.3" dir="0.25 -0.65 -0.9" diffuse=".75 .72 .66" specular=".5 .5 .5"/>
<light pos="1.5 -2 1.5" dir="-0.5 0.75 -0.5" diffuse=".28 .31 .36" castshadow="false"/>"""
"""A lamp, and opposite a window."""
VIGNETTING = 0.35
"""Loss of light in the corners."""
DISTORTION = 0.06
"""Barrel distortion of the lens, relative to the squared half diagonal."""
WHITE = (1.06, 1.0, 0.86)
"""Colour of the light, not balanced."""
ELECTRONS, READ_NOISE = 900.0, 4.0
"""Electrons of a white pixel, and standard deviation of the sensor's reading."""

Light = NDArray[np.float64]
"""(height, width, 3), 0 black to 1 white."""


def rendering() -> bytes:
    """Render the plain picture, JPEG: the scene's own camera, flat colours."""
    model = mujoco.MjModel.from_xml_string(WORLD.read_text(encoding="utf-8"))
    with Painter(model, WIDTH, HEIGHT) as painter:
        return _encoded(painter.paint(_forwarded(model), "workspace"))


def photo(seed: int = 0) -> bytes:
    """Render the photo, JPEG: textures, a lamp and daylight, lens and sensor."""
    random = np.random.default_rng(seed)
    model = _textured(random)
    lamp = model.light_pos[0].copy()
    seen = np.zeros((HEIGHT, WIDTH, 3))
    with Painter(model, WIDTH, HEIGHT) as painter:
        for shift in random.uniform(-LAMP_RADIUS, LAMP_RADIUS, (LAMPS, 3)):
            painter.model.light_pos[0] = lamp + shift
            seen += painter.paint(_forwarded(painter.model), CAMERA) / (255.0 * LAMPS)
    return _encoded(_sensed(_through_lens(seen), random))


def _textured(random: np.random.Generator) -> mujoco.MjModel:
    """Compile the world with textures in place of its materials' colours, and other lights."""
    skins = {
        "wood": _wood(random),
        "floor": _mottled(random, (0.42, 0.43, 0.45), 0.05),
        "glass": _mottled(random, (0.08, 0.30, 0.17), 0.02),
        "paint": _mottled(random, (0.75, 0.16, 0.12), 0.03),
        "card": _mottled(random, (0.90, 0.74, 0.25), 0.04),
    }
    assets = ""
    files: dict[str, bytes] = {}
    for name, skin in skins.items():
        # Flat surfaces are dull; the others wrap the texture around them.
        kind, shine = ("2d", 0.1) if name in ("wood", "floor") else ("cube", 0.6)
        assets += (
            f'<texture name="{name}" type="{kind}" file="{name}.png"/>'
            f'<material name="{name}" texture="{name}" specular="{shine}" shininess="0.5"/>'
        )
        files[f"{name}.png"] = _encoded(_bytes(skin), "PNG")
    xml = re.sub(r"<material .*/>", "", WORLD.read_text(encoding="utf-8"))
    xml = re.sub(r"<light .*/>", LIGHTS, xml.replace("</asset>", f"{assets}</asset>"))
    return mujoco.MjModel.from_xml_string(xml, files)


def _wood(random: np.random.Generator) -> Light:
    """(512, 512, 3) planks along x, each with its own grain."""
    size = 512
    y, x = np.mgrid[0:size, 0:size] / size
    plank = np.floor(8 * y)
    wander = 0.012 * np.sin(2 * np.pi * (1.5 * x + random.uniform(size=9)[plank.astype(int)]))
    grain = np.sin(2 * np.pi * 40 * (y + wander)) + 0.6 * np.sin(
        2 * np.pi * 97 * (y + wander) + 3 * plank
    )
    tone: NDArray[np.float64] = (
        0.85 + 0.10 * random.uniform(size=9)[plank.astype(int)] + 0.03 * grain
    )
    tone = np.where(8 * y - plank < 0.02, 0.45, tone) + random.normal(0.0, 0.015, tone.shape)
    return np.clip(tone[..., None] * np.array([0.80, 0.62, 0.42]), 0, 1)


def _mottled(
    random: np.random.Generator, colour: tuple[float, float, float], depth: float
) -> Light:
    """(256, 256, 3) colour with stains of several sizes."""
    size = 256
    stains = np.zeros((size, size))
    for n in (4, 16, 64, 256):
        stain = np.ones((size // n, size // n))
        stains += np.kron(random.normal(size=(n, n)), stain)
    return np.clip(np.array(colour) + depth * stains[..., None] / 2, 0, 1)


def _through_lens(seen: Light) -> Light:
    """Lens model: distortion, vignetting, blur of 0.7 pixels."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
    u, v = x - WIDTH / 2, y - HEIGHT / 2
    r2 = (u**2 + v**2) / (WIDTH**2 / 4 + HEIGHT**2 / 4)
    stretch = 1 + DISTORTION * (r2 - 1)
    column = np.clip(np.rint(WIDTH / 2 + u * stretch), 0, WIDTH - 1).astype(int)
    row = np.clip(np.rint(HEIGHT / 2 + v * stretch), 0, HEIGHT - 1).astype(int)
    light = seen[row, column] * (1 - VIGNETTING * r2**2)[..., None]
    blurred = Image.fromarray(_bytes(light)).filter(ImageFilter.GaussianBlur(0.7))
    return np.asarray(blurred) / 255.0


def _sensed(light: Light, random: np.random.Generator) -> Pixels:
    """Sensor model: shot noise (Poisson), read noise, colour of the light."""
    charge = random.poisson(ELECTRONS * light) + random.normal(0.0, READ_NOISE, light.shape)
    return _bytes(charge / ELECTRONS * np.array(WHITE))


def _forwarded(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return data


def _bytes(light: Light) -> Pixels:
    return np.clip(255.0 * light, 0, 255).astype(np.uint8)


def _encoded(pixels: Pixels, form: str = "JPEG") -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, form, quality=85)
    return buffer.getvalue()


if __name__ == "__main__":
    for name, content in zip(FILES, (rendering(), photo()), strict=True):
        (WORLD.parent / name).write_bytes(content)
