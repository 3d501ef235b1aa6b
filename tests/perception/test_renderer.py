from __future__ import annotations

import os
import subprocess
import sys

import mujoco
import numpy as np
import pytest

from palpate.perception.renderer import extent, framing

SCENE = """<mujoco><worldbody><geom type="plane" size="9 9 .1"/>
  <body name="a" pos="1 0 .5"><geom type="box" size=".1 .2 .3"/></body>
  <body name="b" pos="-1 0 .5"><body name="c"><geom size=".1"/></body></body></worldbody></mujoco>"""


def forwarded() -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def test_extent_is_of_the_named_bodies_with_their_children_and_never_of_planes() -> None:
    model, data = forwarded()
    np.testing.assert_allclose(extent(model, data, ["a"]).min(0), [0.9, -0.2, 0.2])
    np.testing.assert_allclose(extent(model, data, ["b"]).max(0), [-0.9, 0.1, 0.6])
    np.testing.assert_allclose(extent(model, data).max(0), [1.1, 0.2, 0.8])


@pytest.mark.parametrize("azimuth", [0, 145, 250])
@pytest.mark.parametrize("aspect", [0.6, 1.6])
def test_framing_has_all_points_in_view_and_touches_the_edge(azimuth: float, aspect: float) -> None:
    model, data = forwarded()
    points = extent(model, data)
    camera = framing(points, aspect=aspect, fovy=40, azimuth=azimuth, margin=1.0)
    az, el = np.radians([camera.azimuth, camera.elevation])
    forward = np.array([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])
    right = np.array([np.sin(az), -np.cos(az), 0])
    eye = camera.lookat - camera.distance * forward
    depth = (points - eye) @ forward
    vertical = abs((points - eye) @ np.cross(right, forward)) / depth / np.tan(np.radians(20))
    horizontal = abs((points - eye) @ right) / depth / np.tan(np.radians(20)) / aspect
    assert max(vertical.max(), horizontal.max()) == pytest.approx(1.0)


ASK = "from palpate.perception.renderer import gl_available, look_ahead; print(*gl_available())"


def available_under(code: str = ASK, **environment: str) -> str:
    return subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
    ).stdout


def test_pictures_can_be_switched_off() -> None:
    answer = available_under(MUJOCO_GL="disable")
    assert answer.startswith("False")
    assert "unset it" in answer


def test_a_missing_opengl_gets_an_install_hint() -> None:
    answer = available_under(MUJOCO_GL="egl", MUJOCO_EGL_DEVICE_ID="77")
    assert answer.startswith("False no usable OpenGL (egl:")
    assert "apt-get install" in answer
    assert answer.count("\n") == 1


def test_a_trial_ahead_gives_the_same_answer() -> None:
    ahead = ASK.replace("print", "look_ahead(); look_ahead(); print")
    answer = available_under(ahead, MUJOCO_GL="egl", MUJOCO_EGL_DEVICE_ID="77")
    assert answer.startswith("False no usable OpenGL (egl:")
    assert available_under(ahead, MUJOCO_GL="disable").startswith("False MUJOCO_GL=disable")
