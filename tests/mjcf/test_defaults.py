"""What an element inherits."""

from __future__ import annotations

from lxml import etree

from palpate.mjcf.elements import STAND_INS, Defaults, replace_unknowns
from palpate.mjcf.reading import parse_document


def test_defaults_follow_classes_and_childclasses() -> None:
    document = parse_document("""<mujoco>
      <default><geom friction="0.1"/>
        <default class="cup"><geom mass="0.2"/><default class="handle"><geom friction="0.3"/></default></default>
      </default>
      <worldbody>
        <geom name="plain"/>
        <body childclass="cup"><geom name="wall"/><body><geom name="grip" class="handle" mass="1"/></body></body>
      </worldbody></mujoco>""")
    defaults = Defaults(document.root)
    geoms = {g.get("name"): g for g in document.root.iter("geom") if g.get("name")}
    by_name = {
        name: (defaults.attribute(g, "mass"), defaults.attribute(g, "friction"))
        for name, g in geoms.items()
    }
    assert by_name == {"plain": (None, "0.1"), "wall": ("0.2", "0.1"), "grip": ("1", "0.3")}


def test_unknowns_beyond_the_listed_numbers_take_the_last_one() -> None:
    (edit,) = replace_unknowns(etree.fromstring('<geom mass="? ?"/>'), STAND_INS)
    assert edit.numbers == {0: "1", 1: "1"}
