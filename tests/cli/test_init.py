"""`palpate init`: a scene to begin with, through the command line."""

import json

import pytest
from PIL import Image
from typer.testing import CliRunner

import palpate as pp
from palpate.cli.app import app
from palpate.studies.scenarios.catalogue import scenario

SEEN = scenario("from_picture")


@pytest.fixture
def png(tmp_path):
    """Any picture: the recorded answer does not look."""
    path = tmp_path / "photo.png"
    Image.new("RGB", (64, 48)).save(path)
    return path


def asked(*arguments: object):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_a_new_scene_has_the_named_objects_and_a_next_step(tmp_path):
    done = asked("init", tmp_path / "desk", "red mug", "soap", "--surface", "desk")
    assert done.exit_code == 0, done.output
    assert "how heavy is the red mug?" in done.output
    scene = pp.load(tmp_path / "desk" / "scene.xml", poses=tmp_path / "desk" / "poses.yaml")
    assert [*scene.objects, *scene.surfaces] == ["red_mug", "soap", "desk"]


def test_a_new_scene_without_names_has_a_mug(tmp_path):
    done = asked("init", tmp_path / "new", "--json")
    assert json.loads(done.stdout)["objects"] == ["mug"]


def test_a_new_scene_is_made_from_a_models_detections_in_a_picture(tmp_path, png):
    settings = SEEN.settings()
    options = ["--image", png, "--poses", settings.poses, "--planner", settings.planner]
    done = asked("init", tmp_path / "new", *options)
    assert done.exit_code == 0, done.output
    scene = pp.load(tmp_path / "new" / "scene.xml", poses=tmp_path / "new" / "poses.yaml")
    assert set(scene.objects) == {"bottle", "carton"}
    assert {str(parameter) for parameter in scene.missing} >= {"bottle.mass", "table.height"}


def test_a_picture_needs_its_camera(tmp_path, png):
    done = asked("init", tmp_path / "new", "--image", png)
    assert done.exit_code == 2
    assert "the camera that took it" in done.stderr
    assert not (tmp_path / "new").exists()
