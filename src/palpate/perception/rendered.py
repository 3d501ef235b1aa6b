"""Simulated camera: a rendered picture with lens distortion, defocus and sensor noise.

The stated intrinsics and pose have errors according to their own standard deviations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from palpate.common.errors import InputError, Unavailable, unknown_name
from palpate.common.pose import Array, Pose
from palpate.perception.detection import MODULES, QUIET, blur_picture, remap, tag_pixels, undistort
from palpate.perception.lens import FOCAL_STD, Lens, Mount
from palpate.perception.renderer import Painter, forward_data, gl_available
from palpate.perception.stage import build_stage
from palpate.perception.tags import SITE
from palpate.scene.camera import Camera

SIZE = (1280, 720)  # px. Width and height of a typical depth camera's colour picture.
# Ratio. Size of the rendered picture relative to the final one, for the pixels that distortion
# moves into view.
MARGIN = 1.3
PAPER = 2e-4  # m. Half the thickness of a printed tag.
DEEPEST = 10.0  # m. Maximum distance of the depth camera.
NEAREST = 0.1  # m. Minimum rendered distance.
FINE = 8  # Texture pixels along a tag module


@dataclass(frozen=True, slots=True)
class Imperfections:
    """Imperfections of a simulated camera. Values are standard deviations unless stated otherwise."""

    # K1, k2, p1, p2, k3, which are known exactly.
    distortion: tuple[float, ...] = (-0.08, 0.03, 5e-4, -3e-4, 0.0)
    blur: float = 0.6  # standard deviation of the blur, pixels
    grain: float = 2.0  # sensor noise, grey levels of 255
    focal: float = FOCAL_STD  # relative error of the focal length
    place: float = 0.002  # error of the camera position along each axis, m
    turn: float = 0.003  # error of the camera rotation about each axis, rad
    # Error of the distance along the view at 1 m, m; it grows with the square of the distance. The
    # default is a stereo matching error of 0.08 px with a baseline of 50 mm (Intel, tuning of D400
    # cameras).
    depth: float = 0.0025


class SimulatedCamera:
    """Camera of a world, with printed tags at the sites named `tag_12`."""

    def __init__(
        self,
        world: mujoco.MjSpec,
        name: str,
        *,
        size: tuple[int, int] = SIZE,
        seed: int = 0,
        imperfections: Imperfections | None = None,
    ) -> None:
        """Draw the errors of the camera from a seeded generator."""
        flaws = imperfections or Imperfections()
        usable, reason = gl_available()
        if not usable:
            raise Unavailable(f"the world's camera cannot be drawn: {reason}")
        cameras: list[mujoco.MjsCamera] = list(world.cameras)
        names = [camera.name for camera in cameras if camera.name]
        if not names:
            raise InputError('the world has no camera: give it one, <camera name="workspace" …/>')
        if name not in names:
            raise unknown_name("camera of the world", name, names)
        self._name, self._flaws, self._random = name, flaws, np.random.default_rng(seed)
        self._model = build_stage(_with_tags(world), soft=False)
        self._data = forward_data(self._model)
        # True pose and lens of the camera in the world.
        index = self._model.camera(name).id
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, self._data.cam_xmat[index])
        stands = Pose.of(self._data.cam_xpos[index], quaternion)
        self._camera = Camera(stands, float(np.deg2rad(self._model.cam_fovy[index])), *size)
        pinhole = Lens.of(self._camera)
        self._true = Lens(pinhole.matrix, size, np.array(flaws.distortion))
        # Stated intrinsics and pose: the true values with random errors.
        zoom = 1 + flaws.focal * self._random.standard_normal()
        told = Lens(pinhole.matrix, size, self._true.distortion, max(flaws.focal, 1e-6))
        self.lens = told.zoom_lens(zoom)  # the lens as specified by its owner
        # The pose of the camera as believed by its owner.
        # Random position and rotation error; the small floor keeps the covariance invertible.
        normal = self._random.standard_normal
        place, turn = flaws.place * normal(3), flaws.turn * normal(3)
        believed = Pose(stands.position + place, (Pose.turn(turn) @ stands).quaternion)
        floor = 1e-12
        spread = [flaws.place**2 + floor] * 3 + [flaws.turn**2 + floor] * 3
        self.mount = Mount(believed, np.diag(spread))

    def shoot(self, qpos: Array | None = None) -> NDArray[np.uint8]:
        """Take a picture (height, width, 3), RGB, at configuration `qpos`; the initial one by
        default.
        """
        self._pose(qpos)
        with self._painter() as painter:
            drawn = np.array(painter.paint(self._data, self._name))
        # Apply distortion, defocus and sensor noise to the ideal picture, in this order.
        pixels = remap(drawn, _through(drawn, self._true))
        pixels = blur_picture(pixels, self._flaws.blur) if self._flaws.blur else pixels
        noisy = pixels + self._flaws.grain * self._random.standard_normal(pixels.shape)
        return np.clip(noisy, 0, 255).astype(np.uint8)

    def depth(self, qpos: Array | None = None) -> NDArray[np.uint16]:
        """Distances along the view (height, width), mm; 0 beyond `DEEPEST`."""
        self._pose(qpos)
        with self._painter() as painter:
            drawn = painter.distances(self._data, self._name)
        # Nearest neighbour lookup: interpolation across edges would invent distances.
        column, row = np.moveaxis(_through(drawn, self._true).round().astype(int), -1, 0)
        far = drawn[row.clip(0, len(drawn) - 1), column.clip(0, drawn.shape[1] - 1)]
        # Stereo noise grows with the square of the distance.
        far = far + self._flaws.depth * far**2 * self._random.standard_normal(far.shape)
        return np.where(far < DEEPEST, 1e3 * far, 0.0).round().astype(np.uint16)

    def _pose(self, qpos: Array | None) -> None:
        if qpos is not None:
            self._data.qpos[:] = qpos
            mujoco.mj_forward(self._model, self._data)

    def _painter(self) -> Painter:
        """Return a painter of the ideal pinhole picture, enlarged by `MARGIN`."""
        model, camera = self._model, self._camera
        # The near plane sets the depth resolution, which must separate a paper tag from its body.
        model.vis.map.znear = NEAREST / model.stat.extent
        # Enlarge the field of view at the same focal length: fovy = 2 atan(h / 2f).
        width, height = (2 * round(MARGIN * side / 2) for side in (camera.width, camera.height))
        fovy = np.degrees(2 * np.arctan(height / 2 / camera.focal))
        model.camera(self._name).fovy[:] = fovy
        return Painter(model, width, height)


def _through(drawn: NDArray[Any], lens: Lens) -> Array:
    """Positions (height, width, 2) of the distorted pixels in the pinhole picture of the same focal
    length.
    """
    (width, height), (rows, columns, *_) = lens.size, drawn.shape
    # Undistort the pixel grid, then shift it to the centre of the larger picture.
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(float)
    there = undistort(lens, grid.reshape(-1, 2)).reshape(height, width, 2)
    return there + np.array([columns - width, rows - height]) / 2


def _with_tags(world: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return the world with a printed tag at each tag site."""
    spec = world.copy()
    model = spec.compile()
    sites: list[mujoco.MjsSite] = list(spec.sites)
    for site in sites:
        match = SITE.fullmatch(site.name)
        if match is not None:
            compiled = model.site(site.name)
            _print(spec, site, int(match[1]), Pose.of(compiled.pos, compiled.quat))
    return spec


def _print(spec: mujoco.MjSpec, site: mujoco.MjsSite, number: int, frame: Pose) -> None:
    """Add a printed tag to the body of a site."""
    name = f"palpate_{site.name}"
    # Texture: the modules with a white margin, enlarged for sharp edges.
    modules = np.pad(tag_pixels(number), QUIET, constant_values=255)
    fine = np.kron(modules, np.ones((FINE, FINE), dtype=np.uint8))
    texture = spec.add_texture(
        name=name,
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        nchannel=3,
        width=len(fine),
        height=len(fine),
    )
    texture.data = np.repeat(fine[..., None], 3, axis=-1).tobytes()
    material = spec.add_material(name=name, specular=0.0, shininess=0.0)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    # The paper includes the white margin around the black square.
    half = float(site.size[0]) * (MODULES + 2 * QUIET) / MODULES
    # A separate body, because a look replaces the geoms of its body.
    paper = site.parent.add_body(pos=frame.position, quat=frame.quaternion)
    paper.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[half, half, PAPER],
        material=name,
        contype=0,
        conaffinity=0,
        mass=0.0,
    )
