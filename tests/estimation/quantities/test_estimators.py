"""Every promised parameter gets an estimate, or an honest word, from an estimator of one's
choice."""

import sys
import types
from dataclasses import replace

import numpy as np
import pytest
from installed import install

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.estimation.estimate import Estimate
from palpate.estimation.quantities.catalogue import catalogue
from palpate.estimation.quantities.estimators import Estimators, estimate_all, known_estimators
from palpate.scene.load import parse_scene
from palpate.trace.recording import Conversion, LeafRun

SCENE = """
<mujoco>
  <worldbody>
    <body name="table" pos="0.4 0 0.08"><geom type="box" size=".5 .5 .02"/></body>
    <body name="bottle" pos="0.5 0.1 0.2"><freejoint/><geom type="cylinder" size=".03 .1"/></body>
  </worldbody>
</mujoco>
"""
MASS = Parameter("bottle", "mass")

MINE = '''
"""An estimator of one's own, in one file: the median instead of a model of the bias."""

import numpy as np

from palpate.estimation.estimate import Estimate, not_measured


def estimate_mass(trace, parameter, body):
    recording = trace.converted(parameter)
    if recording is None:
        return not_measured(parameter, "kg")
    mass = trace.of(recording).wrench[:, 2] / trace.gravity
    method = f"Median of {len(mass)} samples, {body.name}."
    return Estimate.normal(parameter, "kg", np.median(mass), mass.std(), method, (recording,))
'''


@pytest.fixture(scope="module")
def bodies():
    return parse_scene(SCENE).bodies


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """A package with an estimator of its own, as an installer leaves it: one file, and metadata
    with its entry point."""
    point = {"palpate.estimators": "mass.mine = my_estimator:estimate_mass"}
    install(tmp_path, "my_estimator", point, {"my_estimator": MINE})
    monkeypatch.syspath_prepend(tmp_path)
    known_estimators.cache_clear()
    yield
    known_estimators.cache_clear()
    sys.modules.pop("my_estimator", None)


def test_a_parameter_without_a_conversion_is_not_identified(weighing, noises, bodies):
    trace = weighing(0.254, noises["none"])
    mass, height = estimate_all([MASS, Parameter("table", "height")], trace, bodies)
    assert mass.values[0] == pytest.approx(0.254, rel=3e-3)
    assert height.verdict == "not identified"
    assert "before the height of table was measured" in height.method


def test_an_estimator_of_ones_own_is_chosen_by_name(weighing, noises, bodies, installed):
    trace = weighing(0.254, noises["none"])
    (found,) = estimate_all([MASS], trace, bodies, choice={"mass": "mine"})
    assert found.values[0] == pytest.approx(0.254, rel=0.02)
    assert found.method == "Median of 151 samples, bottle."

    assert known_estimators().names("mass") == (
        "contrast",
        "rests-and-passes",
        "single-shot",
        "recording",
        "mine",
    )
    (default,) = estimate_all([MASS], trace, bodies)
    assert "mass = (F_z loaded − F_z empty) / g" in default.method


def test_an_estimator_is_loaded_when_it_is_used(weighing, noises, bodies, installed):
    known = known_estimators()
    estimate_all([MASS], weighing(0.254, noises["none"]), bodies, estimators=known)
    assert "my_estimator" not in sys.modules
    known.load("mass", "mine")
    assert "my_estimator" in sys.modules


def test_the_papers_single_shot_leaves_the_arms_bias_in_and_says_so(weighing, noises, bodies):
    trace = weighing(0.254, noises["lab"])
    (found,) = estimate_all([MASS], trace, bodies, choice={"mass": "single-shot"})
    (contrast,) = estimate_all([MASS], trace, bodies)
    assert found.values[0] == contrast.parts["single-shot"].value
    assert found.stds[0] > 10 * contrast.stds[0]
    assert "not compared with the empty hand" in found.method


@pytest.mark.parametrize(
    ("choice", "words"),
    [
        (
            {"mass": "other"},
            "unknown estimator of mass 'other'; valid: contrast, recording, rests-and-passes, single-shot",
        ),
        ({"weight": "contrast"}, "unknown estimator of weight 'contrast'; valid: none"),
    ],
)
def test_an_unknown_choice_lists_the_valid_ones(weighing, noises, bodies, choice, words):
    with pytest.raises(InputError, match=words):
        estimate_all([MASS], weighing(0.254, noises["none"]), bodies, choice)


def test_an_estimator_that_cannot_be_loaded_is_named(weighing, noises, bodies):
    broken = Estimators({"mass": {"mine": "no_such_package:estimate"}})
    with pytest.raises(InputError, match="'no_such_package:estimate' cannot be loaded"):
        estimate_all([MASS], weighing(0.254, noises["none"]), bodies, estimators=broken)


def test_another_partys_quantity_brings_its_own_estimator(weighing, noises, bodies, monkeypatch):
    parameter = Parameter("bottle", "temperature")
    trace = weighing(0.254, noises["none"])
    reading = Conversion("MeasureTemperature", "bottle", "temperature", trace.recordings[0], 1.0)
    trace = replace(trace, conversions=(reading,))

    def thermometer(trace, parameter, body):
        return Estimate.normal(parameter, "°C", 21.0, 0.5, "read", (trace.converted(parameter),))

    assert estimate_all([parameter], trace, bodies)[0].verdict == "not identified"
    monkeypatch.setitem(sys.modules, "thermometer", types.SimpleNamespace(estimate=thermometer))
    own = Estimators({"temperature": {"mean": "thermometer:estimate"}})
    assert estimate_all([parameter], trace, bodies, estimators=own)[0].values == (21.0,)


def test_an_estimator_that_fails_costs_its_own_parameter_alone(
    weighing, noises, bodies, monkeypatch
):
    def broken(trace, parameter, body):
        raise IndexError("list index out of range")

    def adrift(trace, parameter, body):
        return Estimate.normal(parameter, "m", np.nan, 0.1, "")

    broken_package = types.SimpleNamespace(broken=broken, adrift=adrift)
    monkeypatch.setitem(sys.modules, "broken_package", broken_package)
    known = dict(known_estimators())
    known |= {"height": {"it": "broken_package:broken"}, "com": {"it": "broken_package:adrift"}}
    asked = [Parameter("table", "height"), Parameter("bottle", "com"), MASS]
    trace = weighing(0.254, noises["none"])
    height, com, mass = estimate_all(asked, trace, bodies, estimators=Estimators(known))
    assert height.verdict == com.verdict == "not identified"
    assert "IndexError: list index out of range" in height.method
    assert "finite" in com.method
    assert mass.values[0] == pytest.approx(0.254, rel=3e-3)


def test_a_mass_that_was_recorded_before_the_run_was_broken_off_counts(weighing, noises, bodies):
    trace = weighing(0.254, noises["none"])
    (last,) = trace.leaves[-1:]
    failed = replace(last, node="later", start=last.end, end=last.end + 1.0, status="FAILURE")
    (found,) = estimate_all([MASS], replace(trace, leaves=(*trace.leaves, failed)), bodies)
    (whole,) = estimate_all([MASS], trace, bodies)
    assert found == whole


def test_a_mass_recorded_while_the_run_was_broken_off_does_not_count(weighing, noises, bodies):
    trace = weighing(0.254, noises["none"])
    recording = trace.recordings[0]
    slipped = LeafRun("x", "MovePose", "MovePose(up)", recording.start, recording.end, "FAILURE")
    (found,) = estimate_all([MASS], replace(trace, leaves=(*trace.leaves, slipped)), bodies)
    assert found.verdict == "not identified"
    assert "MovePose(up) and after is no evidence" in found.method


def test_inertia_without_swings_is_not_identified(weighing, noises, bodies):
    trace = weighing(0.254, noises["none"])
    (found,) = estimate_all([Parameter("bottle", "inertia")], trace, bodies)
    assert found.verdict == "not identified"
    assert "not excited" in found.method
    assert len(found.values) == 0


@pytest.mark.parametrize("quantity", catalogue().values(), ids=lambda q: q.id)
def test_every_estimator_of_the_catalogue_fulfils_the_contract(bench, noises, bodies, quantity):
    b = bench(noises["none"])
    b.go("somewhere", (0.5, 0.0, 0.3))
    parameter = Parameter("bottle", quantity.id)
    for name in known_estimators().names(quantity.id):
        (found,) = estimate_all([parameter], b.trace(), bodies, {quantity.id: name})
        assert (found.parameter, found.unit) == (parameter, quantity.unit)
        assert found.verdict == "not identified"
        assert found.method
