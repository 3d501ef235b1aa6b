"""What a model boxed roughly ends where the pixels say, and stays as it is where they do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.common.errors import InputError
from palpate.common.pose import Array
from palpate.scene.detections import Pixels, SceneObject, directions, sharpen_boxes
from palpate.scene.picture_scene import SceneBuilder, fit, project_points
from palpate.scene.poses import parse_poses

HEIGHT, WIDTH = 120, 160
OAK, BLUE = (0.76, 0.60, 0.42), (0.16, 0.42, 0.82)
TABLE = SceneObject("table", "plane", (0.02, 0.02, 0.98, 0.98))
CAN = SceneObject("can", "cylinder", (0.25, 0.25, 0.375, 0.5))
"""20 by 30 pixels, from (40, 30)."""

CAMERA = SceneBuilder(
    parse_poses(
        "camera: {pos: [1.15, 0, 1.1], quat: [0.6826014, 0.1845407, 0.1845407, 0.6826014], fovy: 45, "
        "size: [1024, 768]}"
    )
).camera


def table(seed: int = 0) -> Array:
    """Grained wood, light and dark."""
    random = np.random.default_rng(seed)
    light = 0.9 + 0.08 * random.standard_normal((HEIGHT, WIDTH, 1))
    return np.clip(light * np.array(OAK), 0, 1)


def painted(view: Array) -> Pixels:
    return (255 * view).astype(np.uint8)


def with_can() -> Array:
    view = table()
    view[30:60, 60:75] *= 0.5  # its shadow
    view[30:60, 40:60] = np.array(BLUE)
    view[40:48, 40:60] = 0.9  # its label
    return view


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.05, -0.03), (-0.1, 0.1)])
def test_a_misplaced_box_is_moved_to_its_object_without_the_shadow(
    shift: tuple[float, float],
) -> None:
    dx, dy = shift
    left, top, right, bottom = CAN.bbox
    rough = replace(CAN, bbox=(left + dx, top + dy, right + dx, bottom + dy))
    plane, can = sharpen_boxes([TABLE, rough], painted(with_can()))
    assert plane == TABLE
    assert can.bbox == pytest.approx(CAN.bbox, abs=1.01 / WIDTH)
    assert can.outline is not None
    assert sharpen_boxes([TABLE, can], painted(table())) == (TABLE, can), "once is enough"


def test_the_models_box_stays_where_no_region_is_like_it() -> None:
    empty = painted(table())
    assert sharpen_boxes([TABLE, CAN], empty) == (TABLE, CAN)
    crowd = replace(CAN, bbox=(0.25, 0.25, 0.7, 0.9))
    assert sharpen_boxes([TABLE, crowd], painted(with_can())) == (TABLE, crowd)


def test_on_a_table_of_many_colours_the_models_box_stays() -> None:
    random = np.random.default_rng(1)
    motley = painted(random.random((HEIGHT, WIDTH, 3)))
    assert sharpen_boxes([TABLE, CAN], motley) == (TABLE, CAN)


def test_a_colour_region_belongs_to_one_object() -> None:
    further = replace(CAN, name="cup", bbox=(0.3, 0.3, 0.425, 0.55))
    _, can, cup = sharpen_boxes([TABLE, CAN, further], painted(with_can()))
    assert can.outline is not None
    assert cup == further


def outlined(name: str, shape: str, points: Array) -> SceneObject:
    """A thing whose outline is seen without fault."""
    seen = project_points(CAMERA, points)
    corners = seen[np.argmax(seen @ directions(32).T, axis=0)] / [CAMERA.width, CAMERA.height]
    low, high = corners.min(axis=0), corners.max(axis=0)
    outline = tuple((float(x), float(y)) for x, y in corners)
    return SceneObject(name, shape, (*low, *high), outline=outline)  # type: ignore[arg-type]


def test_a_turned_block_of_any_ground_plan_is_found_by_its_outline() -> None:
    turn, (w, d, h) = np.radians(20.0), (0.035, 0.028, 0.12)
    ground = np.array([[w, d], [w, -d], [-w, -d], [-w, d]]) @ np.array(
        [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
    )
    points = np.array([[0.58 + x, -0.16 + y, 0.03 + z] for x, y in ground for z in (0.0, h)])
    result = fit(CAMERA, outlined("carton", "box", points), 0.03)
    assert (result.x, result.y, result.width, result.depth, result.height) == pytest.approx(
        (0.58, -0.16, 2 * w, 2 * d, h), abs=1e-3
    )
    assert result.yaw == pytest.approx(turn, abs=0.01)


def test_a_bottle_is_as_wide_as_its_widest_part() -> None:
    turn = np.linspace(0, 2 * np.pi, 200)
    rings = [(0.032, 0.0), (0.032, 0.12), (0.013, 0.2)]
    points = np.concatenate(
        [
            np.column_stack([0.5 + r * np.cos(turn), 0.12 + r * np.sin(turn), np.full(200, z)])
            for r, z in rings
        ]
    )
    result = fit(CAMERA, outlined("bottle", "cylinder", points), 0.0)
    assert (result.x, result.y) == pytest.approx((0.5, 0.12), abs=2e-3)
    assert (result.width, result.height) == pytest.approx((0.064, 0.2), abs=4e-3)


@pytest.mark.parametrize("shift", [(0.35, 0.0), (0.3, 0.35), (-0.01, 0.45)])
def test_a_box_far_from_its_object_is_refused_with_how_far_and_how_large(
    shift: tuple[float, float],
) -> None:
    """Beyond the search distance, 12 % of the diagonal."""
    dx, dy = shift
    left, top, right, bottom = CAN.bbox
    rough = replace(CAN, bbox=(left + dx, top + dy, right + dx, bottom + dy))
    off = 100 * np.hypot(dx * WIDTH, dy * HEIGHT) / np.hypot(WIDTH, HEIGHT)
    message = (
        rf"the box of 'can', 12 % x 25 % of the image, shows bare table; .* 1[23] % x 2[45] %, is {off:.0f} % of .*: "
        r"look again, and correct the box of 'can', perhaps to \[0.250, 0.250, 0.375, 0.500\]"
    )
    with pytest.raises(InputError, match=message):
        sharpen_boxes([TABLE, rough], painted(with_can()))
    assert sharpen_boxes([TABLE, rough], painted(table())) == (TABLE, rough), (
        "there is nothing else"
    )


def test_a_box_of_an_object_in_the_tables_colour_stays() -> None:
    pale = replace(CAN, name="pale", bbox=(0.6, 0.4, 0.725, 0.65))
    _, can, left = sharpen_boxes([TABLE, CAN, pale], painted(with_can()))
    assert can.outline is not None
    assert left == pale
