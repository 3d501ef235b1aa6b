"""Outlines and volumes of geoms against MuJoCo's own."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.mjcf.reading import parse_document
from palpate.mjcf.roles import find_roles
from palpate.mjcf.shapes import Shapes, compile_shapes, geom_volume, hull_edges, hull_points

KINDS = {"box": 3, "cylinder": 2, "capsule": 2, "sphere": 1, "ellipsoid": 3}


def shapes(world: str, before: str = "") -> Shapes:
    document = parse_document(f"<mujoco>{before}<worldbody>{world}</worldbody></mujoco>")
    return compile_shapes(document, find_roles(document), [])


@given(st.sampled_from(sorted(KINDS)), st.tuples(*[st.floats(0.01, 0.2)] * 3))
@settings(max_examples=60, deadline=None)
def test_shapes_have_the_volume_and_extents_of_mujoco(
    kind: str, size: tuple[float, float, float]
) -> None:
    numbers = " ".join(str(s) for s in size[: KINDS[kind]])
    model = shapes(
        f'<body><freejoint/><geom type="{kind}" size="{numbers}" density="1"/></body>'.replace(
            "<body>", '<body name="b">'
        )
    )
    assert geom_volume(model.model, 0) == pytest.approx(float(model.model.body_mass[1]), rel=1e-6)
    points = hull_points(model.model, 0)
    half = model.model.geom_aabb[0][3:]
    assert points.max(axis=0) == pytest.approx(half, rel=1e-6)
    assert points.min(axis=0) == pytest.approx(-half, rel=1e-6)


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_edges_hold_the_hull_together(kind: str) -> None:
    """Between any two heights, the edges' crossings reach as far out as all pairs of points
    would."""
    model = shapes(
        f'<geom type="{kind}" size="{" ".join(["0.05", "0.08", "0.03"][: KINDS[kind]])}" euler="20 30 0"/>'
    )
    points = model.geom_points(0)
    edges = hull_edges(int(model.model.geom_type[0]), len(points))
    every = np.column_stack(np.triu_indices(len(points), 1))

    def reach(pairs: np.ndarray, level: float) -> np.ndarray:
        a, b = points[pairs[:, 0]], points[pairs[:, 1]]
        crossing = (a[:, 2] - level) * (b[:, 2] - level) < 0
        a, b = a[crossing], b[crossing]
        at = a + (level - a[:, 2:]) / (b[:, 2:] - a[:, 2:]) * (b - a)
        return np.concatenate([at[:, :2].max(axis=0), at[:, :2].min(axis=0)])

    for level in np.linspace(points[:, 2].min() * 0.9, points[:, 2].max() * 0.9, 7):
        assert reach(edges, level) == pytest.approx(reach(every, level), abs=5e-4)


def test_a_mesh_is_where_its_file_says() -> None:
    vertices = "0 0 0 .1 0 0 0 .1 0 0 0 .1"
    model = shapes(
        '<body name="b" pos="1 2 3"><freejoint/><geom type="mesh" mesh="m"/></body>',
        f'<asset><mesh name="m" vertex="{vertices}" face="0 2 1 0 1 3 0 3 2 1 2 3"/></asset>',
    )
    assert model.geom_points(0).min(axis=0) == pytest.approx([1, 2, 3], abs=1e-6)
    assert model.geom_points(0).max(axis=0) == pytest.approx([1.1, 2.1, 3.1], abs=1e-6)
    assert geom_volume(model.model, 0) == pytest.approx(0.1**3 / 6, rel=1e-5)


def test_planes_without_a_size_are_wide() -> None:
    model = shapes('<geom type="plane" size="0 0.5 1" pos="0 0 0.2"/>')
    extent = model.geom_points(0).max(axis=0) - model.geom_points(0).min(axis=0)
    assert extent[0] > 10
    assert extent[1:] == pytest.approx([1, 0])
    assert model.solid_geoms() == []
    assert model.model.geom_type[0] == mujoco.mjtGeom.mjGEOM_PLANE


def test_warnings_of_mujoco_are_logged_and_no_file_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    ball = '<mujoco><worldbody><body><freejoint/><geom size=".1"/></body></worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(ball)
    data = mujoco.MjData(model)
    data.qpos[0] = np.nan
    mujoco.mj_step(model, data)
    assert "MuJoCo: Nan, Inf or huge value in QPOS" in caplog.text
    assert list(tmp_path.iterdir()) == []
