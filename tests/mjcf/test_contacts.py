"""Friction of contacts, compared with that of MuJoCo's own contacts."""

from __future__ import annotations

from itertools import product

import mujoco
import pytest

from palpate.mjcf.contacts import contact_friction

TEXT = """<mujoco><option o_friction="0.9 0.9 0 0 0">{override}</option><worldbody>
<geom name="a" type="box" size="1 1 1" pos="0 0 -1" {a}/>
<body pos="0 0 0.0999"><freejoint/><geom name="b" type="box" size=".1 .1 .1" {b}/></body>
</worldbody><contact>{pair}</contact></mujoco>"""
GEOMS = [
    f'friction="{friction}" priority="{priority}" condim="{condim}"'
    for friction, priority, condim in ((0.3, 0, 3), (0.7, 0, 1), (0.2, 1, 3), (0.5, 1, 1))
]
PAIRS = [
    "",
    '<pair geom1="a" geom2="b" friction=".45 .35"/>',
    '<pair geom1="b" geom2="a" friction=".45" condim="1"/>',
]


@pytest.mark.parametrize("override", ["", '<flag override="enable"/>'])
@pytest.mark.parametrize("pair", PAIRS)
def test_friction_is_that_of_mujocos_contact(override: str, pair: str) -> None:
    for a, b in product(GEOMS, GEOMS):
        text = TEXT.format(a=a, b=b, pair=pair, override=override)
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        contact = data.contact
        slides = contact.friction[:, :2].min() * bool(contact.dim.min() >= 3)
        ids = model.geom("a").id, model.geom("b").id
        for one, other in (ids, ids[::-1]):
            assert contact_friction(model, one, other) == pytest.approx(slides), (a, b)
