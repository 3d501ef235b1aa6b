"""Room for the arm in a scene."""

from __future__ import annotations

import pytest

from palpate.common.errors import InputError
from palpate.primitives.rules.collision_geometry import require_room
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene


def among(*bodies: str) -> Scene:
    return parse_scene(f"<mujoco><worldbody>{''.join(bodies)}</worldbody></mujoco>")


def block(name: str, x: float, z: float, joint: str = "") -> str:
    """A cube of 0.2 m about a point above the x axis."""
    return f'<body name="{name}" pos="{x} 0 {z}">{joint}<geom type="box" size=".1 .1 .1" mass="1"/></body>'


def test_bodies_next_to_the_arm_or_below_it_leave_it_room() -> None:
    require_room(among(block("table", 0.5, -0.1), block("pedestal", 0.0, -0.05)))


@pytest.mark.parametrize(
    ("name", "x", "z", "joint", "inside"),
    [("table", 0.12, 0.25, "", "link1"), ("parcel", 0.3, 0.44, "<freejoint/>", "finger")],
)
def test_body_inside_the_arm_is_named_before_any_plan(
    name: str, x: float, z: float, joint: str, inside: str
) -> None:
    scene = among(block(name, x, z, joint), block("far", 0.6, -0.1))
    with pytest.raises(InputError, match=rf"its .*{inside} is .* mm inside '{name}'"):
        require_room(scene)
