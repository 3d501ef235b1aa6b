"""Stiffness: mats, cloths and cushions pressed by the fingertips, in recordings and on an arm."""

import numpy as np
import pytest
from recordings import HAND

import palpate as pp
from palpate.common.parameter import Parameter
from palpate.estimation.quantities.stiffness import estimate_stiffness
from palpate.estimation.spring import damping_ratio, restitution
from palpate.mjcf.contacts import FINGERTIPS
from palpate.robots.owner import load_description
from palpate.scene.load import parse_scene
from palpate.twin.inject import inject
from palpate.twin.validate import rest_depth

STIFFNESS, DAMPING = Parameter("mat", "stiffness"), Parameter("mat", "contact_damping")
TOP = 0.28


def spring(stiffness):
    return lambda z: max(0.0, TOP - z) * stiffness


def pressed(bench, noise, press, seed=0, places=((0.5, 0.0),)):
    """A descent on each of some places."""
    b = bench(noise, seed)
    for x, y in places:
        b.go("mat_approach", (x, y, 0.32))
        b.descend(press, "mat")
    return estimate_stiffness(b.trace(), STIFFNESS, None)


@pytest.mark.parametrize(
    ("world", "tolerance"), [("none", 0.01), ("lab", 0.03), ("datasheet", 0.05)]
)
@pytest.mark.parametrize("stiffness", [60, 300, 1000, 3000, 10000])
def test_the_stiffness_of_springs_of_any_strength_is_identified(
    bench, noises, world, tolerance, stiffness
):
    errors = []
    for seed in range(4):
        found = pressed(bench, noises[world], spring(stiffness), seed)
        assert found.verdict == "identified"
        low, high = found.intervals[0]
        assert low < stiffness < high
        errors.append(found.values[0] / stiffness - 1.0)
    assert np.sqrt(np.mean(np.square(errors))) < tolerance


def test_stiffness_comes_with_the_height_of_first_contact(bench, noises):
    contact = pressed(bench, noises["lab"], spring(1000)).parts["first contact"]
    assert contact.value == pytest.approx(TOP, abs=3e-4)
    assert contact.std >= HAND.tip_offset_std


@pytest.mark.parametrize("world", ["none", "lab", "datasheet"])
def test_a_table_is_stiffer_than_the_resolution(bench, noises, world):
    found = pressed(bench, noises[world], spring(1e6))
    assert found.verdict == "not identified"
    assert "stiffer than" in found.method


def test_a_cloth_is_judged_by_itself_and_not_by_the_table_below(bench, noises):
    def cloth(z):
        return max(0.0, TOP - z) * 500 + max(0.0, TOP - 0.008 - z) * 1e5

    found = pressed(bench, noises["lab"], cloth)
    assert found.values[0] == pytest.approx(500, rel=0.05)
    assert found.verdict == "identified"


def test_a_hardening_spring_is_contradicted(bench, noises):
    found = pressed(bench, noises["lab"], lambda z: 3e4 * max(0.0, TOP - z) ** 2)
    assert found.verdict == "contradicted"
    assert "proportion" in found.contradiction


@pytest.mark.parametrize("world", ["lab", "datasheet"])
def test_two_layers_are_no_even_spring(bench, noises, world):
    def layers(z):
        depth = max(0.0, TOP - z)
        return 800 * min(depth, 0.0015) + 6000 * max(depth - 0.0015, 0.0)

    found = pressed(bench, noises[world], layers)
    assert found.verdict == "contradicted"
    assert "spring" in found.contradiction


def test_a_rough_signal_makes_no_spring_uneven(bench, noises):
    """Forces that come late, are held, and are wild now and then."""
    b = bench(noises["lab"])
    b.go("mat_approach", (0.5, 0.0, 0.32))
    b.descend(spring(800), "mat")
    trace = b.trace()
    random = np.random.default_rng(0)
    wrench = trace.samples.wrench
    late = np.arange(len(wrench)) - 1 - (random.random(len(wrench)) < 0.1)
    wild = random.random(len(wrench)) < 0.02
    wrench[:] = wrench[np.maximum(late, 0)] + random.normal(0.0, 10.0, wrench.shape) * wild[:, None]
    found = estimate_stiffness(trace, STIFFNESS, None)
    assert found.verdict == "identified"
    assert found.values[0] == pytest.approx(800, rel=0.03)


def test_stiffness_averages_all_touches(bench, noises):
    places = ((0.45, 0.0), (0.5, 0.0), (0.55, 0.0))
    once = pressed(bench, noises["lab"], spring(600))
    found = pressed(bench, noises["lab"], spring(600), places=places)
    assert found.values[0] == pytest.approx(600, rel=0.03)
    assert found.stds[0] < 0.7 * once.stds[0]
    assert len(found.evidence) == 3


def test_places_of_different_stiffness_contradict_each_other(bench, noises):
    b = bench(noises["lab"])
    for x, stiffness in ((0.45, 400), (0.55, 900)):
        b.go("mat_approach", (x, 0.0, 0.32))
        b.descend(spring(stiffness), "mat")
    found = estimate_stiffness(b.trace(), STIFFNESS, None)
    assert found.verdict == "contradicted"
    assert "equally stiff" in found.contradiction


def test_stiffness_without_a_touch_is_not_identified(bench, noises):
    b = bench(noises["lab"])
    b.go("mat_approach", (0.5, 0.0, 0.32))
    assert estimate_stiffness(b.trace(), STIFFNESS, None).verdict == "not identified"


SCENE = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="mat" pos="0.5 0 0.1"><geom type="box" size=".15 .15 .01" friction="0.6"{low}/>{cover}</body>
</worldbody></mujoco>"""
COVER = """<body gravcomp="1" pos="0 0 0.006"><joint type="slide" axis="0 0 1" stiffness="{}" damping="{}"/>
  <geom type="box" size=".15 .15 .004" mass="0.3"/></body>"""


def test_the_stiffness_of_a_mat_gets_from_the_sentence_to_the_twin(tmp_path):
    """From the sentence to a twin that gives way as measured, on an arm whose hidden mat rests on a spring; the
    same arm feels the same in the twin."""
    world, twin = tmp_path / "world.xml", tmp_path / "twin.xml"
    world.write_text(SCENE.format(low=' pos="0 0 -0.032"', cover=COVER.format(800, 40)))
    scene = pp.load(SCENE.format(low="", cover=""))
    assert scene.plan("how soft is the mat?").parameters == (STIFFNESS,)
    plan = scene.plan("the damping of the mat")
    assert set(plan.parameters) == {STIFFNESS, DAMPING}
    assert plan.findings == ()
    run = plan.run(world=world, noise="lab", seed=1, fast=True)
    found, damping = run["mat.stiffness"], run["mat.contact_damping"]
    assert found.verdict == damping.verdict == "identified"
    assert found.values[0] == pytest.approx(800, rel=0.03)
    assert damping.ci95[0] < 40 < damping.ci95[1]
    (note,) = run.twin.notes
    assert "as measured" in note
    twin.write_text(run.twin.xml)
    again = plan.run(world=twin, noise="lab", seed=2, fast=True)
    for parameter, (truth,) in again.truth.items():
        assert truth == pytest.approx(run[parameter].value, rel=1e-2)
        assert again[parameter].value == pytest.approx(truth, abs=3.0 * again[parameter].std)


@pytest.mark.parametrize(("is_known", "verdict"), [(True, "identified"), (False, "not identified")])
def test_a_hard_mat_of_known_height_is_distinguished_from_a_table(bench, noises, is_known, verdict):
    """30 kN/m met at a stated height is the mat's; at an unknown one, a table below something too soft to feel."""
    b = bench(noises["lab"])
    b.go("mat_approach", (0.5, 0.0, 0.32))
    b.descend(spring(30_000), "mat")
    z = "0.27" if is_known else "?"
    text = f"""<mujoco><worldbody><site name="robot_base"/><body name="mat" pos="0.5 0 {z}">
      <geom type="box" size=".15 .15 .01"/></body></worldbody></mujoco>"""
    found = estimate_stiffness(b.trace(), STIFFNESS, parse_scene(text).body("mat"))
    assert found.verdict == verdict
    if is_known:
        assert found.ci95[0] < 30_000 < found.ci95[1]


@pytest.mark.parametrize("option", ["", '<option cone="elliptic" solver="PGS" timestep="0.004"/>'])
@pytest.mark.parametrize("friction", [0.4, 1.3])
def test_a_softened_surface_gives_way_in_every_solver_and_cone(option, friction):
    text = f"""<mujoco>{option}<worldbody><site name="robot_base"/><body name="mat" pos="0.5 0 0.27">
      <geom type="box" size=".15 .15 .01" friction="{friction}"/></body></worldbody></mujoco>"""
    for stiffness in (500.0, 50_000.0):
        written = inject(text, {STIFFNESS: (stiffness,)})
        twin = parse_scene(written)
        assert twin.body("mat").known["stiffness"] == pytest.approx((stiffness,), rel=1e-3)
        assert rest_depth(twin, "mat", 6.0, stiffness) == pytest.approx(6.0 / stiffness, rel=5e-3)


def test_damping_without_a_stiffness_is_not_in_the_twin():
    text = SCENE.format(low="", cover="")
    with pytest.raises(pp.InputError, match="together with a stiffness"):
        inject(text, {DAMPING: (30.0,)})


@pytest.mark.parametrize("arm", ["fr3", "iiwa14", "ur5e"])
def test_fingertips_count_in_a_contact_as_their_models_do(arm):
    """16 points, four of each of two boxes a finger that end at the tips."""
    description = load_description(arm)
    model = description.spec().compile()
    finger = model.jnt_bodyid[model.joint(description.hand.fingers[0]).id]
    assert 16 / model.body_invweight0[finger, 0] == pytest.approx(FINGERTIPS, rel=0.01)


@pytest.mark.parametrize(
    ("seed", "stiffness", "damping", "low", "told"),
    [(107, 86, 8, -0.0222, True), (113, 64, 2.4, -0.0124, False)],
)
def test_a_very_soft_mat_is_not_taken_for_the_surface_below(
    tmp_path, seed, stiffness, damping, low, told
):
    """14 mm of a mat that bear 1.2 N above something rigid are told at `lab`; 4.4 mm that bear 0.3 N are
    not."""
    world = tmp_path / "world.xml"
    cover = COVER.format(stiffness, damping)
    world.write_text(SCENE.format(low=f' pos="0 0 {low}"', cover=cover))
    scene = pp.load(SCENE.format(low="", cover=""))
    run = scene.plan("how soft is the mat?").run(world=world, noise="lab", seed=seed, fast=True)
    found = run["mat.stiffness"]
    if told:
        assert found.values[0] == pytest.approx(stiffness, rel=0.1)
    else:
        assert found.verdict == "not identified"
        assert "stiffer than" in found.method


@pytest.mark.parametrize("zeta", [0.05, 0.4, 0.9, 1.0, 1.3])
def test_restitution_is_that_of_a_spring_and_a_damper(zeta):
    """Against the motion in small steps, until the force is zero."""
    x, v, dt = 0.0, -1.0, 1e-4
    while True:
        force = -x - 2.0 * zeta * v
        if force < 0.0 < v:
            break
        v += force * dt
        x += v * dt
    assert restitution(zeta) == pytest.approx(v, rel=1e-2)


def test_restitution_is_reported_for_a_mat_and_not_for_a_table(tmp_path):
    plan = pp.load(SCENE.format(low="", cover="")).plan(measure="mat.restitution")
    world = tmp_path / "world.xml"
    soft = ' solref="-150 -15" solimp="0.05 0.05 0.001" solmix="1000000"'
    for low, verdict in ((soft, "identified"), ("", "not identified")):
        world.write_text(SCENE.format(low=low, cover=""))
        found = plan.run(world=world, seed=5, fast=True)["mat.restitution"]
        assert found.verdict == verdict
        if found.has_value:
            per_unit = FINGERTIPS / 0.95
            truth = restitution(damping_ratio(150 * per_unit, 15 * per_unit))
            assert found.ci95[0] < truth < found.ci95[1]
        else:
            assert "too fast" in found.method
