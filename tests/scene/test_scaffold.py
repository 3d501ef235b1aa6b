"""A new scene: what is written is a scene that can be read, planned for and corrected."""

import hypothesis.strategies as st
import mujoco
import pytest
from hypothesis import given, settings

import palpate as pp
from palpate.common.errors import InputError
from palpate.scene.scaffold import MAX_OBJECTS, kinds, new_scene


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("new") / "my desk"
    return new_scene(folder, ["red mug", "hammer", "dingus"], surface="desk")


def test_objects_of_a_new_scene_miss_mass_and_friction_alone(made):
    scene = pp.load(made.scene, poses=made.poses)
    assert tuple(scene.objects) == ("red_mug", "hammer", "dingus")
    assert tuple(scene.surfaces) == ("desk",)
    missing = {str(parameter) for parameter in scene.missing}
    assert missing == {f"{name}.{q}" for name in scene.objects for q in ("mass", "friction")}


def test_a_plan_is_found_for_each_of_them(made):
    scene = pp.load(made.scene, poses=made.poses)
    for name in scene.objects:
        plan = scene.plan(f"how heavy is the {name.replace('_', ' ')}?")
        assert plan.run_so_far.ready, name


def test_a_full_table_stands_apart(tmp_path):
    names = sorted(kinds())[:MAX_OBJECTS]
    scene = pp.load(new_scene(tmp_path, names).scene)
    assert scene.plan(f"how heavy is the {names[7]}?").run_so_far.ready
    model = mujoco.MjModel.from_xml_string(new_scene(tmp_path / "again", names).scene.read_text())
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    bodies = {tuple(sorted(model.geom_bodyid[c.geom])) for c in data.contact[: data.ncon]}
    table = model.body("table").id
    assert all(table in pair for pair in bodies), "two things touch each other"


def test_existing_files_are_not_overwritten(made):
    before = made.scene.read_text()
    with pytest.raises(InputError, match="exists already"):
        new_scene(made.scene.parent, ["cup"])
    assert made.scene.read_text() == before


@pytest.mark.parametrize(
    ("names", "surface", "complaint"),
    [
        (["7up"], "table", "starts with a letter"),
        (["cup", "cup"], "table", "called 'cup'"),
        (["table"], "table", "surface's name"),
        (["x"] * (MAX_OBJECTS + 1), "table", "too many"),
    ],
)
def test_names_and_folders_that_cannot_be_used_are_refused(tmp_path, names, surface, complaint):
    with pytest.raises(InputError, match=complaint):
        new_scene(tmp_path / "new", names, surface)
    assert not (tmp_path / "new").exists()


@settings(max_examples=25, deadline=None)
@given(name=st.text(max_size=70))
def test_any_name_is_an_object_or_an_error(tmp_path_factory, name):
    folder = tmp_path_factory.mktemp("any") / "new"
    try:
        scaffold = new_scene(folder, [name])
    except InputError:
        assert not folder.exists()
        return
    assert tuple(pp.load(scaffold.scene).objects) == scaffold.objects
