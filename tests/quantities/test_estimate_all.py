"""Every promised gap gets an estimate, or an honest word."""

import pytest

from palpate.errors import InputError
from palpate.estimation.estimate import Estimate
from palpate.parameter import Parameter
from palpate.quantities.estimate_all import derive, estimate_all
from palpate.scene.load import parse_scene
from palpate.trace.recording import Conversion

SCENE = """
<mujoco>
  <worldbody>
    <body name="table" pos="0.4 0 0.08"><geom type="box" size=".5 .5 .02"/></body>
    <body name="bottle" pos="0.5 0.1 0.2"><freejoint/><geom type="cylinder" size=".03 .1"/></body>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def scene():
    return parse_scene(SCENE)


def with_conversion(weighing, noises, *conversions):
    from dataclasses import replace

    trace, weighed = weighing(0.254, noises["none"])
    return replace(trace, conversions=conversions or (weighed,)), weighed


def test_converted_and_missing(weighing, noises, scene):
    trace, _ = with_conversion(weighing, noises)
    mass, height = estimate_all(
        [Parameter("bottle", "mass"), Parameter("table", "height")], trace, scene
    )
    assert mass.value[0] == pytest.approx(0.254, rel=3e-3)
    assert height.verdict == "not identified"
    assert "before the height of table was measured" in height.method


def test_another_partys_quantity_brings_its_own_estimator(weighing, noises, scene):
    trace, weighed = with_conversion(weighing, noises)
    parameter = Parameter("bottle", "temperature")
    reading = Conversion("MeasureTemperature", "bottle", "temperature", weighed.recording, 1.0)
    trace, _ = with_conversion(weighing, noises, reading)

    def thermometer(trace, conversion):
        return Estimate(
            parameter, (21.0,), (0.5,), ((20.0, 22.0),), "read", (conversion.recording,)
        )

    assert estimate_all([parameter], trace, scene)[0].verdict == "not identified"
    assert estimate_all([parameter], trace, scene, {"MeasureTemperature": thermometer})[
        0
    ].value == (21.0,)


def test_inertia_is_not_excited(weighing, noises, scene):
    trace, _ = weighing(0.254, noises["none"])
    found = derive(Parameter("bottle", "inertia"), trace, scene)
    assert found.verdict == "not identified"
    assert found.value == ()


def test_what_is_not_derived_is_refused(weighing, noises, scene):
    trace, _ = weighing(0.254, noises["none"])
    with pytest.raises(InputError, match="valid: com, friction, inertia"):
        derive(Parameter("bottle", "mass"), trace, scene)
