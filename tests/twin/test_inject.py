"""The user's text with the estimates in it, and nothing else changed."""

from __future__ import annotations

import difflib
import re
from pathlib import Path

import mujoco
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate, FurtherValue
from palpate.estimation.quantities.catalogue import catalogue
from palpate.scene.load import load_scene, parse_scene
from palpate.scene.remarks import remarks
from palpate.twin.inject import complete, inject, unfilled_unknowns

SCENE = """<?xml version="1.0" encoding="utf-8"?>
<!-- Messung vom Dienstag: Höhe unbekannt -->
<mujoco model='lab "1"'>
\t<option   timestep = "0.002"
            gravity="0 0 -9.81"/>

  <worldbody>
    <!-- the table <body mass="?"> -->
    <body name='table' pos = '0.50  0   ?' >
      <geom name="top" type="box" size="0.3 0.4 0.020"/> <!-- oak -->
    </body>
    <body name="bottle" pos="0.5 0.1 0.28"><freejoint/>
      <geom name="glass" rgba="0 0 1 1" type="cylinder"
            size="0.03 0.10" />
    </body>
    <body name="known" pos="0.5 -0.2 0.23">
      <freejoint/><geom type="box" size=".03 .03 .05" mass="0.300" friction="0.40 0.005 0.0001"/>
    </body>
  </worldbody>
</mujoco>
<!-- end -->
"""


def estimate(
    name: str,
    quantity: str,
    *value: float,
    std: float = 0.001,
    method: str = "by touch",
    **parts: FurtherValue,
) -> Estimate:
    return Estimate(
        Parameter(name, quantity),
        catalogue()[quantity].unit if quantity in catalogue() else "1",
        value,
        (std,) * len(value),
        tuple((v - 2 * std, v + 2 * std) for v in value),
        method,
        (),
        parts=parts,
    )


def changed_lines(before: str, after: str) -> list[str]:
    return [
        line for line in difflib.ndiff(before.splitlines(), after.splitlines()) if line[:1] in "+-"
    ]


def body(text: str, name: str) -> mujoco.MjsBody:
    return mujoco.MjModel.from_xml_string(text).body(name)


def test_answered_numbers_alone_change() -> None:
    text = inject(
        SCENE, {Parameter("table", "height"): (0.18,), Parameter("bottle", "mass"): (0.254,)}
    )
    assert changed_lines(SCENE, text) == [
        "-     <body name='table' pos = '0.50  0   ?' >",
        "+     <body name='table' pos = '0.50  0   0.16' >",
        '-             size="0.03 0.10" />',
        '+             size="0.03 0.10" mass="0.254" />',
    ]
    assert body(text, "bottle").mass[0] == pytest.approx(0.254)


def test_records_are_written_into_custom() -> None:
    records = [
        estimate("bottle", "mass", 0.25412, std=0.0008, method='weighed "twice" <well> & cleanly'),
        estimate("bottle", "friction", 0.34, static=FurtherValue(0.41, 0.02)),
    ]
    text = inject(
        SCENE,
        {r.parameter: tuple(r.values) for r in records} | {Parameter("table", "height"): (0.18,)},
        records,
    )
    model = mujoco.MjModel.from_xml_string(text)
    assert model.numeric("palpate_bottle_mass").data == pytest.approx(
        [0.25412, 0.0008, 0.25252, 0.25572]
    )
    assert model.numeric("palpate_bottle_friction_static").data == pytest.approx([0.41, 0.02])
    assert 'weighed "twice" <well> & cleanly' in "".join(
        etree.fromstring(text.encode()).xpath("//custom/text/@data")
    )
    assert 'mass="0.25412"' in text
    assert text.endswith("<!-- end -->\n")


def test_numbers_have_the_digits_their_deviation_deserves() -> None:
    records = [estimate("bottle", "mass", 0.2541234567, std=0.02)]
    assert 'mass="0.254"' in inject(
        SCENE, {records[0].parameter: tuple(records[0].values)}, records
    )
    exact = [estimate("bottle", "mass", 0.2541234567, std=0.0)]
    assert 'mass="0.2541235"' in inject(SCENE, {exact[0].parameter: tuple(exact[0].values)}, exact)


def test_measuring_again_updates_the_record_in_place() -> None:
    first = inject(
        SCENE, {Parameter("bottle", "mass"): (0.25,)}, [estimate("bottle", "mass", 0.25)]
    )
    second = inject(
        first, {Parameter("bottle", "mass"): (0.26,)}, [estimate("bottle", "mass", 0.26)]
    )
    assert second.count("palpate_bottle_mass_method") == 1
    assert len(changed_lines(first, second)) == 4, changed_lines(first, second)
    assert 'mass="0.2600"' in second


def test_an_existing_custom_is_continued() -> None:
    text = SCENE.replace(
        "</mujoco>", '  <custom>\n    <numeric name="mine" data="1"/>\n  </custom>\n</mujoco>'
    )
    after = inject(text, {Parameter("bottle", "mass"): (0.25,)}, [estimate("bottle", "mass", 0.25)])
    assert [e.get("name") for e in etree.fromstring(after.encode()).find("custom")] == [
        "mine",
        "palpate_bottle_mass",
        "palpate_bottle_mass_method",
    ]
    empty = SCENE.replace("</mujoco>", "<custom/></mujoco>")
    after = inject(
        empty, {Parameter("bottle", "mass"): (0.25,)}, [estimate("bottle", "mass", 0.25)]
    )
    assert len(etree.fromstring(after.encode()).find("custom")) == 2


def test_com_makes_an_inertial_that_moves_the_balance() -> None:
    records = [estimate("bottle", "com", 0.001, 0.0, -0.03), estimate("bottle", "mass", 0.2)]
    values = {r.parameter: tuple(r.values) for r in records} | {
        Parameter("table", "height"): (0.18,)
    }
    text = inject(SCENE, values, records)
    bottle = body(text, "bottle")
    assert bottle.ipos == pytest.approx([0.001, 0, -0.03])
    assert bottle.mass[0] == pytest.approx(0.2)
    about_middle = 0.2 * (3 * 0.03**2 + 0.2**2) / 12
    assert max(bottle.inertia) == pytest.approx(about_middle + 0.2 * (0.001**2 + 0.03**2), rel=1e-3)
    assert (
        '<geom name="glass" rgba="0 0 1 1" type="cylinder"\n            size="0.03 0.10" />' in text
    )
    with pytest.raises(InputError, match="without its mass"):
        inject(SCENE, {Parameter("bottle", "com"): (0, 0, 0)})


@pytest.mark.parametrize(
    ("thing", "values", "expected"),
    [
        (
            '<geom type="box" size=".02 .02 .02" mass="?" friction="? 0.01 0.002"/>',
            {"mass": (0.3,), "friction": (0.35,)},
            'mass="0.3" friction="0.35 0.01 0.002" priority="1"',
        ),
        (
            '<geom type="box" size=".02 .02 .02" mass="1" friction=" ? "/>',
            {"friction": (0.35,)},
            'friction=" 0.35 "',
        ),
        (
            '<geom type="box" size=".02 .02 .02" density="?" friction="1"/>',
            {"mass": (0.064,)},
            'density="1000"',
        ),
        (
            '<inertial pos="? 0.001 ?" mass="?" diaginertia="1e-4 1e-4 1e-4"/><geom size=".02" friction="1"/>',
            {"mass": (0.3,), "com": (0.01, 0.02, 0.03)},
            'pos="0.01 0.001 0.03" mass="0.3" diaginertia="1e-4 1e-4 1e-4"',
        ),
        (
            '<inertial pos="?" mass="?" diaginertia="?"/><geom size=".02" friction="1"/>',
            {"mass": (0.3,), "com": (0, 0, 0), "inertia": (4e-5, 4e-5, 4e-5, 0, 0, 0)},
            'pos="0 0 0" mass="0.3" diaginertia="4e-05 4e-05 4e-05"',
        ),
        (
            '<inertial pos="0 0 0" mass="1" diaginertia="? ? ?"/><geom size=".02" friction="1"/>',
            {"inertia": (4e-5, 3e-5, 2e-5, 1e-6, 0, -2e-6)},
            'mass="1" fullinertia="4e-05 3e-05 2e-05 1e-06 0 -2e-06"/>',
        ),
        (
            '<inertial pos="0 0 0" quat="1 0 0 1" mass="1" diaginertia="?"/><geom size=".02" friction="1"/>',
            {"inertia": (4e-5, 3e-5, 2e-5, 0, 0, 0)},
            'diaginertia="3e-05 4e-05 2e-05"',
        ),
        (
            '<geom size=".02" mass="?" friction="0.4 ? 0.001"/>',
            {"mass": (0.3,)},
            'mass="0.3" friction="0.4 0.005 0.001"',
        ),
        (
            '<geom size=".02" mass="1" friction="1" priority="3"/>',
            {"friction": (0.35,)},
            'friction="0.35" priority="3"',
        ),
    ],
)
def test_every_place_of_a_number_is_edited(
    thing: str, values: dict[str, tuple[float, ...]], expected: str
) -> None:
    text = f'<mujoco><worldbody><body name="a" pos="0.5 0 0.02"><freejoint/>{thing}</body></worldbody></mujoco>'
    after = inject(text, {Parameter("a", quantity): value for quantity, value in values.items()})
    assert expected in after
    mujoco.MjModel.from_xml_string(after)


@pytest.mark.parametrize(
    ("surface", "expected"),
    [
        (
            '<body name="t" pos="0 0 0.1"><geom type="box" size="1 1 .1" pos="0 0 ?"/></body>',
            'pos="0 0 0.55"',
        ),
        ('<body name="t" pos="0 0 0.1"><geom type="box" size="1 1 ?"/></body>', 'size="1 1 0.65"'),
        (
            '<body name="t" pos="0 0 0.15"><geom type="box" size="1 1 ?" pos="0 0 ?"/></body>',
            'size="1 1 0.3" pos="0 0 0.3"',
        ),
        (
            '<body name="t" pos="0 0 ?"><geom type="box" size="1 1 ?"/></body>',
            'pos="0 0 0.375"><geom type="box" size="1 1 0.375"',
        ),
        ('<geom name="t" type="cylinder" size="1 ?" pos="0 0 0.25"/>', 'size="1 0.5"'),
        ('<geom name="t" type="plane" size="1 1 1" pos="0 0 ?"/>', 'pos="0 0 0.75"'),
        (
            '<body name="t" pos="0 0 ?"><geom type="box" size="1 1 .1"/>'
            '<geom type="box" size=".1 .1 .1" pos="0 0 -.3"/>'
            "</body>",
            'pos="0 0 0.65"',
        ),
    ],
)
def test_a_height_solves_for_the_number_that_is_open(surface: str, expected: str) -> None:
    text = f"<mujoco><worldbody>{surface}</worldbody></mujoco>"
    after = inject(text, {Parameter("t", "height"): (0.75,)})
    assert expected in after
    scene = parse_scene(after)
    assert scene.surfaces["t"].known["height"] == pytest.approx((0.75,))


def test_position_and_an_open_height_of_an_object() -> None:
    text = (
        '<mujoco><worldbody><geom name="t" type="box" size="1 1 .1" pos="0 0 ?"/>'
        '<body name="a" pos="? 0.2 ?"><freejoint/><geom size=".02" mass="1" friction="1"/></body></worldbody>'
        "</mujoco>"
    )
    after = inject(
        text, {Parameter("t", "height"): (0.5,), Parameter("a", "position"): (0.43, 0.99)}
    )
    assert 'pos="0.43 0.2 0.52"' in after, "y is known and stays"


def test_an_unknown_in_a_defaults_class_is_answered_on_each_geom() -> None:
    text = (
        '<mujoco><default><default class="w"><geom mass="?" friction="? 0.01 0.001"/></default></default>'
        "<worldbody>"
        '<body name="a" pos="0.5 0 0.02"><freejoint/><geom class="w" size=".02"/></body>'
        '<body name="b" pos="0.4 0 0.02"><freejoint/><geom class="w" size=".02"/></body></worldbody></mujoco>'
    )
    half = {Parameter("a", "mass"): (0.1,), Parameter("a", "friction"): (0.2,)}
    after = inject(text, half)
    assert '<geom mass="?" friction="? 0.01 0.001"/>' in after
    assert unfilled_unknowns(after) == [Parameter("b", "friction"), Parameter("b", "mass")]
    after = inject(after, {Parameter("b", "mass"): (0.3,), Parameter("b", "friction"): (0.4,)})
    model = mujoco.MjModel.from_xml_string(after)
    assert [model.body(n).mass[0] for n in "ab"] == pytest.approx([0.1, 0.3])
    assert model.geom_friction[:, 0] == pytest.approx([0.2, 0.4])


CLASSES = """<mujoco><default><geom mass="0.5"/><default class="a"><geom mass="?"/>
<default class="b"><geom density="300"/></default></default></default><worldbody>
<body name="cup" {inherits}><freejoint/><geom {own} type="box" size=".02 .03 .05"/>{more}</body></worldbody></mujoco>"""


@given(
    inherits=st.sampled_from(["", 'childclass="a"', 'childclass="b"']),
    own=st.sampled_from(['class="a"', 'class="b"', 'class="a" density="500"', 'density="?"']),
    more=st.sampled_from(["", '<geom class="b" size=".02"/>', '<geom mass="0.1" size=".02"/>']),
)
@settings(max_examples=30, deadline=None)
def test_an_unknown_in_a_chain_of_classes_overrules_those_above(
    inherits: str, own: str, more: str
) -> None:
    text = CLASSES.format(inherits=inherits, own=own, more=more)
    assert parse_scene(text).objects["cup"].missing == {"mass", "friction"}
    twin = inject(text, {Parameter("cup", "mass"): (0.31,)})
    assert body(twin.replace('friction="?"', ""), "cup").mass[0] == pytest.approx(0.31)


def test_several_geoms_share_the_mass() -> None:
    text = (
        '<mujoco><worldbody><body name="a" pos="0.5 0 0.02"><freejoint/><geom type="box" size=".02 .02 .02"/>'
        '<geom type="box" size=".02 .02 .06" pos="0 0 .08"/></body></worldbody></mujoco>'
    )
    after = inject(text, {Parameter("a", "mass"): (0.4,)})
    assert re.findall(r' mass="([^"]*)"', after) == ["0.1", "0.3"]


def test_a_value_in_an_included_file_brings_its_content_in(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "cup.xml").write_text(
        '<?xml version="1.0"?><mujoco>\n  <!-- the cup -->\n  <body name="cup" pos="0.5 0 0.02"><freejoint/>'
        '<geom size=".02"/></body></mujoco>'
    )
    text = (
        '<mujoco><worldbody>\n<include file="parts/cup.xml"/>\n<body name="pot" pos="0.4 0 0.02"><freejoint/>'
        '<geom size=".02"/></body></worldbody></mujoco>'
    )
    kept = inject(text, {Parameter("pot", "mass"): (0.3,)}, folder=tmp_path)
    assert '<include file="parts/cup.xml"/>' in kept
    merged = inject(text, {Parameter("cup", "mass"): (0.2,)}, folder=tmp_path)
    assert "<!-- the cup -->" in merged
    assert "include" not in merged
    assert body(merged, "cup").mass[0] == pytest.approx(0.2)


def test_completing_a_scene_answers_every_mark_and_says_what_was_assumed(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(SCENE.replace('type="cylinder"', 'type="cylinder" mass="?"'))
    scene = load_scene(path)
    twin = complete(scene, [estimate("bottle", "mass", 0.254)])
    assert twin.notes == ("table.height was not measured; the twin holds the assumed value 0.18",)
    assert unfilled_unknowns(twin.texts.main) == []
    mujoco.MjModel.from_xml_string(twin.texts.main)
    twin = complete(scene, [estimate("table", "height", 0.181)])
    assert [n.split(" was")[0] for n in twin.notes] == ["bottle.mass"]
    assert "palpate_bottle" not in twin.texts.main, "an assumption is not recorded as an estimate"


def test_a_measured_value_that_cannot_be_written_is_not_called_unmeasured() -> None:
    scene = parse_scene(SCENE.replace('type="cylinder"', 'type="cylinder" mass="?"'))
    twin = complete(scene, [estimate("bottle", "mass", -0.002), estimate("table", "height", 0.18)])
    refused, assumed = twin.notes
    assert refused.startswith("bottle.mass is not in the twin: ")
    assert assumed.startswith("bottle.mass: the twin holds the assumed value ")
    # Without a value of its own, as where the evidence disagrees.
    asked = complete(scene, [estimate("table", "height", 0.18)], {Parameter("bottle.mass")})
    assert asked.notes == (assumed,)


def test_an_assumed_inertia_goes_with_the_measured_mass_and_centre() -> None:
    text = (
        '<mujoco><worldbody><body name="a" pos="0.5 0 0.03"><freejoint/>'
        '<inertial pos="?" mass="?" diaginertia="?"/>'
        '<geom type="box" size=".1 .02 .03" friction="1"/></body></worldbody></mujoco>'
    )
    twin = complete(
        parse_scene(text), [estimate("a", "mass", 0.6), estimate("a", "com", 0.04, 0.0, 0.0)]
    )
    assert [n.split(" was")[0] for n in twin.notes] == ["a.inertia"]
    about_middle = 0.6 / 12 * (0.2**2 + 0.06**2)
    assert max(body(twin.texts.main, "a").inertia) == pytest.approx(
        about_middle + 0.6 * 0.04**2, rel=1e-5
    )


def test_a_value_that_makes_no_sense_stays_out_with_a_note() -> None:
    twin = complete(
        parse_scene(SCENE), [estimate("bottle", "mass", -0.002), estimate("table", "height", 0.18)]
    )
    assert [n for n in twin.notes if n.startswith("bottle.mass is not in the twin")]
    assert twin.unwritten == (Parameter("bottle.mass"),)
    assert body(twin.texts.main, "bottle").mass[0] > 0
    assert "palpate_bottle" not in twin.texts.main


ODD = """<mujoco>{before}<worldbody>
  <body name="table" pos="0.5 0 0.2"><geom type="box" size="0.3 0.4 0.02"/></body>
  <body name="mug" pos="0.5 0 0.27"><freejoint/>{mug}</body>
</worldbody></mujoco>"""
WALL = '<geom type="box" size=".03 .03 .05"'
OPEN_WEDGE = """<asset><mesh name="wedge" face="0 1 2 1 3 2 0 4 1 1 4 5"
    vertex="-.03 -.03 -.05 .03 -.03 -.05 -.03 .03 -.05 .03 .03 -.05 -.03 0 .05 .03 0 .05"/></asset>"""
SHELL_WEDGE = OPEN_WEDGE.replace("face", 'inertia="shell" face')
HANDLE = '<geom type="box" pos=".04 0 0" size=".01 .01 .02"'


@pytest.mark.parametrize(
    ("mug", "before"),
    [
        (f'{WALL}/>{HANDLE} mass="?"/>', ""),
        (f'{WALL}/>{HANDLE} mass="0.02"/>', ""),
        (f'{WALL} density="?"/>{HANDLE} density="300"/>', ""),
        (f'{WALL} mass="?" group="3"/>{HANDLE} group="1"/>', '<compiler inertiagrouprange="3 4"/>'),
        (
            f'<inertial pos="0 0 0" mass="?" diaginertia="1 1 1"/>{WALL}/>'
            f'<body>{HANDLE} mass="0.03"/></body>',
            "",
        ),
        (
            f'{WALL}/><body><inertial pos="0 0 0" mass="0.01" diaginertia="1e-5 1e-5 1e-5"/>{HANDLE}/></body>',
            "",
        ),
        (
            f'<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>{WALL} mass="?"/>',
            '<compiler inertiafromgeom="true"/>',
        ),
        (f'<geom type="mesh" mesh="wedge" density="?"/>{HANDLE} density="300"/>', OPEN_WEDGE),
        (f'<geom type="mesh" mesh="wedge" density="?"/>{HANDLE} mass=".02"/>', SHELL_WEDGE),
        (f'{WALL} shellinertia="true" density="?"/>', ""),
    ],
)
def test_mujoco_reads_the_written_value(mug: str, before: str) -> None:
    scene = parse_scene(ODD.format(before=before, mug=mug))
    assert "mass" in scene.body("mug").missing
    twin = complete(scene, [estimate("mug", "mass", 0.18)])
    assert twin.unwritten == ()
    model = mujoco.MjModel.from_xml_string(twin.texts.main)
    assert model.body_subtreemass[model.body("mug").id] == pytest.approx(0.18, rel=1e-5)


def test_a_value_that_the_file_overrules_is_not_in_the_twin() -> None:
    before = '<compiler settotalmass="2"/>'
    scene = parse_scene(ODD.format(before=before, mug=f"{WALL}/>"))
    twin = complete(scene, [estimate("mug", "mass", 0.18)])
    assert twin.unwritten == (Parameter("mug.mass"),)
    assert "another statement of the file overrides it" in twin.notes[0]
    with pytest.raises(InputError, match="cannot be stated in this file"):
        inject(scene.text, {Parameter("mug.mass"): (0.18,)})


def test_parts_that_outweigh_the_whole_are_reported() -> None:
    scene = parse_scene(ODD.format(before="", mug=f'{WALL}/>{HANDLE} mass="0.3"/>'))
    twin = complete(scene, [estimate("mug", "mass", 0.18)])
    assert twin.unwritten == (Parameter("mug.mass"),)
    assert "the parts with a stated mass weigh 0.3 kg" in twin.notes[0]


def test_unknown_names_are_refused() -> None:
    with pytest.raises(InputError, match="no object or surface 'cup'"):
        inject(SCENE, {Parameter("cup", "mass"): (1,)})


def test_character_references_and_line_breaks_between_numbers() -> None:
    text = SCENE.replace("0.50  0   ?", "0.50&#32;0 ?")
    assert body(
        inject(text, {Parameter("table", "height"): (0.18,)}), "table"
    ).pos == pytest.approx([0.5, 0, 0.16])
    text = SCENE.replace("0.50  0   ?", "0.50\n\t0\r\n ?")
    assert "0.50\n\t0\r\n 0.16" in inject(text, {Parameter("table", "height"): (0.18,)})


space = st.sampled_from(
    ["", " ", "\n", "\n\n    ", "\t", "\r\n  ", " <!-- ? mass='?' <geom/> -->", "<!--é\n-->\n"]
)
parameter = st.sampled_from([" ", "  ", "\n      ", "\t"])
quote = st.sampled_from("'\"")
names = st.text(
    st.characters(categories=["L", "N"], include_characters=" _-.&<'\"/"), min_size=1, max_size=8
).filter(lambda n: n.strip() == n and n not in ("table", "world"))


@st.composite
def scenes(draw: st.DrawFn) -> tuple[str, str, set[str]]:
    """An MJCF text in some hand's style, the object's name, and which of its attributes are
    open."""
    name = draw(names)

    def attribute(key: str, value: str) -> str:
        mark = draw(quote)
        value = (
            value.replace("&", "&amp;")
            .replace("<", "&lt;")
            .replace(mark, "&quot;" if mark == '"' else "&apos;")
        )
        equals = draw(st.sampled_from(["=", " = "]))
        return f"{draw(parameter)}{key}{equals}{mark}{value}{mark}"

    z = draw(st.sampled_from(["?", "0.3"]))
    mass = draw(st.sampled_from(["", "?", "0.2"]))
    friction = draw(st.sampled_from(["", "?", "0.5", "? 0.01 0.001", " ?  0.01"]))
    geom = [("type", "box"), ("size", "0.02  0.030 .05"), ("rgba", "1 0 0 1")]
    geom += [("mass", mass)] if mass else []
    geom += [("friction", friction)] if friction else []
    geom = draw(st.permutations(geom))
    s = [draw(space) for _ in range(8)]
    end = draw(st.sampled_from(["/>", " />", "></geom>"]))
    text = (
        f"{'' if draw(st.booleans()) else '<!-- head -->'}<mujoco>{s[0]}<worldbody>{s[1]}"
        f"<geom{attribute('name', 'table')}{attribute('type', 'box')}{attribute('pos', f'0.5 0{draw(parameter)}{z}')}"
        f"{attribute('size', '0.4 0.4 0.1')}/>{s[2]}<body{attribute('name', name)}{attribute('pos', '0.5 0 0.45')}>"
        f"{s[3]}<freejoint/>{s[4]}<geom{''.join(attribute(k, v) for k, v in geom)}{end}{s[5]}</body>{s[6]}"
        f"</worldbody>{s[7]}</mujoco>"
    )
    missing = ({"height"} if z == "?" else set()) | ({"mass"} if mass in ("", "?") else set())
    missing |= {"friction"} if friction.split()[:1] in ([], ["?"]) else set()
    return text, name, missing


def strip(text: str) -> list[tuple[str, dict[str, str]]]:
    root = etree.fromstring(text.encode())
    for custom in root.findall("custom"):
        root.remove(custom)
    return [(e.tag, dict(e.attrib)) for e in root.iter(etree.Element)]


@given(scenes())
@settings(max_examples=150, deadline=None)
def test_any_style_of_text_survives(case: tuple[str, str, set[str]]) -> None:
    text, name, missing = case
    scene = parse_scene(text)
    assert {g.quantity for g in scene.missing} == missing
    known = {"height": ("table", (0.41,)), "mass": (name, (0.254,)), "friction": (name, (0.33,))}
    records = [estimate(known[q][0], q, *known[q][1]) for q in sorted(missing)]
    after = inject(text, {r.parameter: tuple(r.values) for r in records}, records)
    model = mujoco.MjModel.from_xml_string(after)
    before, now = strip(text), strip(after)
    assert [tag for tag, _ in before] == [tag for tag, _ in now]
    allowed = {"mass", "friction", "priority", "pos"}
    changes = {
        key
        for (_, a), (_, b) in zip(before, now, strict=True)
        for key in a.keys() | b.keys()
        if a.get(key) != b.get(key)
    }
    assert changes <= allowed
    assert re.findall(r"<!--.*?-->", text, re.S) == re.findall(r"<!--.*?-->", after, re.S)
    assert subsequence(re.sub(r"\?", "", text), after), (
        "every other character is still there, in order"
    )
    if "mass" in missing:
        assert model.body(name).mass[0] == pytest.approx(0.254)
    if "friction" in missing:
        assert model.geom_friction[1][0] == pytest.approx(0.33)
    if "height" in missing:
        assert model.geom("table").pos[2] == pytest.approx(0.31)
    assert inject(text, {}, []) == text


def subsequence(part: str, whole: str) -> bool:
    rest = iter(whole)
    return all(character in rest for character in part)


RUBBING = """<mujoco>{before}<worldbody><geom name="table" type="box" size=".3 .3 .02" {table}/>
<body name="cup" pos="0 0 0.07"><freejoint/><geom name="c" type="box" size=".02 .03 .05" mass="0.2" {cup}/>
</body></worldbody>{after}</mujoco>"""


PAIR = '<contact><pair geom1="c" geom2="table" {}/></contact>'


def rubbing(before: str = "", table: str = "", cup: str = "", after: str = "") -> str:
    """A cup on a table whose friction is larger than what is measured."""
    table = f'friction="0.9" {table}'
    return RUBBING.format(before=before, table=table, cup=cup, after=after)


@pytest.mark.parametrize(
    "text",
    [
        rubbing(),
        rubbing(cup='priority="0"'),
        rubbing(table='priority="1"'),
        rubbing(table='priority="3"', cup='priority="3"'),
        rubbing(table='condim="1"'),
        # MuJoCo takes nothing from the geoms of an explicit pair.
        rubbing(after=PAIR.format("")),
        rubbing(after=PAIR.format('friction=".8"')),
        rubbing(after=PAIR.format('friction=".8 .7 .01"'), cup='friction="0.3"'),
        rubbing('<default><pair friction=".6 .6"/></default>', after=PAIR.format("")),
    ],
)
def test_a_friction_that_is_written_acts(text: str) -> None:
    model = mujoco.MjModel.from_xml_string(inject(text, {Parameter("cup", "friction"): (0.42,)}))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 5)
    assert data.contact[0].friction[:2] == pytest.approx(0.42)
    assert data.contact[0].dim == 3


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (rubbing(cup='condim="1"'), "no friction"),
        (rubbing('<option><flag override="enable"/></option>'), "<option> overrides"),
        (rubbing(after=PAIR.format('condim="1"')), "no friction"),
    ],
)
def test_a_friction_that_would_not_act_is_not_in_the_twin(text: str, reason: str) -> None:
    twin = complete(parse_scene(text), [estimate("cup", "friction", 0.42)])
    assert [str(parameter) for parameter in twin.unwritten] == ["cup.friction"]
    assert reason in twin.notes[0]


@pytest.mark.parametrize(
    ("compiler", "quantity", "value"),
    [
        ('inertiafromgeom="true"', "com", (0.01, 0.0, 0.02)),
        ('boundinertia="0.01"', "inertia", (1e-4, 2e-4, 1.5e-4, 0, 0, 0)),
        ('balanceinertia="true"', "inertia", (1e-4, 2e-4, 4e-4, 0, 0, 0)),
    ],
)
def test_a_value_that_the_compiler_overrules_is_not_in_the_twin(
    compiler: str, quantity: str, value: tuple[float, ...]
) -> None:
    text = rubbing(f"<compiler {compiler}/>", cup='friction="0.4"')
    twin = complete(parse_scene(text), [estimate("cup", quantity, *value, std=1e-6)])
    assert [str(parameter) for parameter in twin.unwritten] == [f"cup.{quantity}"]


def test_a_hollow_part_next_to_a_stated_one_is_weighed() -> None:
    hollow = 'shellinertia="true" friction="1"/><geom size=".01" mass="0.1"'
    text = rubbing(cup=hollow).replace('mass="0.2" shell', "shell")
    assert body(inject(text, {Parameter("cup", "mass"): (0.25,)}), "cup").mass[0] == pytest.approx(
        0.25
    )


@pytest.mark.parametrize(
    "tie", ['<weld body1="cup" body2="lid"/>', '<connect body1="lid" body2="cup" anchor="0 0 0"/>']
)
def test_a_tied_object_was_not_weighed_alone(tie: str) -> None:
    lid = '<body name="lid" pos="0 0 0.13"><freejoint/><geom size=".01" mass="0.1" friction="1"/></body>'
    text = rubbing(cup='friction="0.4"', after=f"<equality>{tie}</equality>")
    text = text.replace('mass="0.2"', "").replace("</worldbody>", f"{lid}</worldbody>")
    twin = complete(parse_scene(text), [estimate("cup", "mass", 0.3)])
    assert [str(parameter) for parameter in twin.unwritten] == ["cup.mass"]
    assert "it is tied to 'lid' (<equality>), and was lifted with it" in twin.notes[0]
    loose = text.replace("body1", 'active="false" body1')
    assert complete(parse_scene(loose), [estimate("cup", "mass", 0.3)]).unwritten == ()


@pytest.mark.parametrize(
    ("joint", "body", "before"),
    [
        ("<freejoint/>", 'gravcomp="1"', ""),
        ('<joint type="free" frictionloss="1"/>', "", ""),
        ('<joint type="free" damping="5"/>', "", ""),
        ("<freejoint/>", "", '<option density="10000"/>'),
        ("<freejoint/>", "", '<option gravity="0 -9.81 0"/>'),
        ("<freejoint/>", "", '<option><flag gravity="disable"/></option>'),
        ("<freejoint/>", "", '<option gravity="0 0 0"/>'),
    ],
)
def test_an_object_under_other_forces_was_not_weighed(joint: str, body: str, before: str) -> None:
    text = ODD.format(before=before, mug=f"{WALL}/>").replace("<freejoint/>", joint)
    scene = parse_scene(text.replace('name="mug"', f'name="mug" {body}'))
    twin = complete(scene, [estimate("mug", "mass", 0.18)])
    assert twin.unwritten == (Parameter("mug.mass"),)


def test_an_object_that_cannot_be_weighed_alone_is_noted_beforehand() -> None:
    text = ODD.format(before="", mug=f"{WALL}/>").replace('"mug"', '"mug" gravcomp="1"')
    message = " ".join(remarks(parse_scene(text)))
    assert (
        "A measurement of 'mug' in the hand would be wrong: gravcomp carries a part of its weight"
        in message
    )


def test_weak_forces_do_not_keep_an_object_from_being_weighed() -> None:
    joint = '<joint type="free" damping="0.0005" armature="0.001"/>'
    text = ODD.format(before='<option density="1.2"/>', mug=f"{WALL}/>")
    scene = parse_scene(text.replace("<freejoint/>", joint))
    assert complete(scene, [estimate("mug", "mass", 0.18)]).unwritten == ()


def test_keyframes_keep_their_places_and_a_note_says_so() -> None:
    text = SCENE.replace("</mujoco>", '<keyframe><key qpos="{}"/></keyframe></mujoco>')
    text = text.format("0.5 0.1 0.28 1 0 0 0 0.5 -0.2 0.23 1 0 0 0")
    twin = complete(parse_scene(text), [estimate("table", "height", 0.181)])
    assert "the keyframes keep their stated poses" in twin.notes
    weighed = complete(parse_scene(SCENE), [estimate("table", "height", 0.181)])
    assert not any("keyframes" in note for note in weighed.notes)


ON_TABLE = """<mujoco><worldbody>
  <body name="table" pos="0.5 0 ?"><geom type="box" size=".3 .4 .02"/></body>
  <body name="shelf" pos="0.5 0.2 0.245"><geom type="box" size=".1 .1 .025"/></body>
  {other}
  <body name="cup" pos="0.5 0.2 0.32"><freejoint/><geom type="box" size=".03 .03 .05" mass=".2" friction=".5"/></body>
  <body name="can" pos="0.5 -0.1 0.27"><freejoint/><geom type="box" size=".03 .03 .05" mass=".2" friction=".5"/></body>
</worldbody></mujoco>"""


@pytest.mark.parametrize("top", [0.211, 0.229])
def test_a_static_body_on_a_surface_follows_its_measured_height(top: float) -> None:
    """And what stands on that body; a body beside the surface stays."""
    floor = '<geom name="step" type="box" size=".1 .2 .05" pos="-.5 0 .05"/>'
    text = ON_TABLE.format(other=floor)
    twin = complete(parse_scene(text), [estimate("table", "height", top)])
    before, after = parse_scene(text).bodies, parse_scene(twin.texts.main).bodies
    rise = top - 0.22
    for name, by in (("shelf", rise), ("cup", rise), ("can", rise), ("step", 0.0)):
        assert after[name].bottom_z() - before[name].bottom_z() == pytest.approx(by, abs=1e-6), name
    assert after["shelf"].bottom_z() == pytest.approx(after["table"].top_z(), abs=1e-6)


def test_a_static_body_whose_height_is_measured_too_keeps_its_own() -> None:
    text = ON_TABLE.format(other="").replace('"0.5 0.2 0.245"', '"0.5 0.2 ?"')
    heights = [estimate("table", "height", 0.211), estimate("shelf", "height", 0.262)]
    after = parse_scene(complete(parse_scene(text), heights).texts.main).bodies
    assert after["shelf"].top_z() == pytest.approx(0.262)
