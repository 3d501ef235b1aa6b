"""The embedded planner: minimal trees from words and geometry, and honest refusals."""

from __future__ import annotations

import pytest
from workbench import (
    BAR,
    BESIDE_ITS_END,
    BOTTLE,
    CRATE,
    KNOWN,
    MUG,
    actions,
    bench,
    parameters,
    weigh,
)

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter, PlanRejected
from palpate.planning.check.check import check
from palpate.planning.plan import Plan
from palpate.planning.symbolic.planner import ExhaustivePlanner, SymbolicPlanner
from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene


@pytest.fixture(scope="module")
def scene() -> Scene:
    return bench(BOTTLE, MUG, CRATE, KNOWN, height="?")


def planned(scene: Scene, request: str | None, **options: bool) -> Plan:
    """A plan that passes the check."""
    plan = SymbolicPlanner(**options).plan(request, scene)
    assert check(plan, scene, remeasure=options.get("remeasure", False)) == ()
    return plan


def test_a_single_mass_takes_the_papers_twelve_actions(scene: Scene):
    plan = planned(scene, "How heavy is the bottle?")
    assert actions(plan.tree) == weigh("bottle")
    assert plan.actions == 12
    assert plan.planner == "symbolic"


def test_measuring_is_grouped_as_in_the_paper(scene: Scene):
    tree = planned(scene, "the mass of the bottle and the height of the bench").tree
    assert tree is not None
    groups = [[n.type for n in node.children] for node in tree.children if node.type == "Sequence"]
    assert groups == [
        ["MoveUntilContact", "MeasureGripperPose", "Pose2Height"],
        ["MeasureForces", "Force2Mass"],
    ]
    assert len(actions(tree)) == 17


def test_an_object_is_grasped_once_for_all_that_is_asked_of_it_in_any_order(scene: Scene):
    asked = [("bottle", "mass"), ("mug", "friction"), ("bottle", "inertia"), ("mug", "inertia")]
    measure = tuple(Parameter(*names) for names in asked)
    plan = SymbolicPlanner(measure=measure).plan(None, scene)
    assert check(plan, scene) == ()
    assert set(plan.parameters) == set(measure)
    assert sum(action.startswith("CloseGripper") for action in actions(plan.tree)) == 2


def test_friction_is_slid_in_the_same_grasp_in_a_triangle(scene: Scene):
    bottle = bench(BOTTLE.replace('friction="0.6"', ""))
    plan = planned(bottle, "mass and friction of the bottle")
    assert plan.tree is not None
    parallel = [node for _, node in plan.tree.walk() if node.type == "Parallel"]
    slide = ["MovePose", "MeasureForces"]
    assert [[n.type for n in node.children] for node in parallel] == [slide, slide]
    done = actions(plan.tree)
    assert done.count("CloseGripper") == 1
    # Along the closing direction, back aside of it, and along the other axis, home.
    there, aside, home = [action for action in done if action.startswith("MovePose")][4:7]
    assert there.startswith("MovePose bottle_pose + ")
    assert there.endswith("*y_offset")
    assert aside.startswith("MovePose bottle_pose + ")
    assert aside.endswith("*x_offset")
    assert home == "MovePose bottle_pose"
    assert plan.actions == 17


def test_friction_is_slid_there_and_back_where_there_is_no_room_aside():
    bottle = bench(BOTTLE.replace('friction="0.6"', ""), *walls("0.56", "0.44"))
    plan = planned(bottle, "friction of the bottle")
    assert actions(plan.tree).count("MeasureForces") == 2
    assert not any("x_offset" in action for action in actions(plan.tree))


def walls(*places: str) -> list[str]:
    """On either side of the bottle, along x."""
    return [
        f'<body name="wall{i}" pos="{x} -0.03 0.01"><geom type="box" size=".005 .12 .01"/></body>'
        for i, x in enumerate(places)
    ]


def test_a_centre_of_mass_takes_three_grasps_and_one_weighing(scene: Scene):
    plan = planned(scene, "the balance point and the mass of the crate")
    done = actions(plan.tree)
    grasps = [done[i - 1] for i, action in enumerate(done) if action == "CloseGripper"]
    assert grasps == [
        "MovePose crate_pose",
        "MovePose crate_pose + x_offset",
        "MovePose crate_pose - x_offset",
    ]
    turns = sum(action.startswith("Turn") for action in done)
    assert (done.count("MeasureForces") - turns, done.count("Force2Mass")) == (3, 1)


@pytest.mark.parametrize("body", [BOTTLE, MUG.replace(' mass="0.3"', "")])
def test_the_grasps_of_a_round_object_hold_it_at_three_spots(body: str):
    """An x_offset of 4 mm is within the tolerance of its place. It is put back before each grasp nevertheless."""
    scene = bench(body, poses="offsets: {x_offset: 0.004}")
    (name,) = scene.objects
    plan = planned(scene, f"the mass and the centre of mass of the {name}")
    done = actions(plan.tree)
    grasp, grasps = "", list[str]()
    for action, before in zip(done[1:], done, strict=False):
        if action == "CloseGripper":
            grasp = before
            grasps.append(grasp)
        if action == "OpenGripper" and grasp:
            assert before == grasp
    at = f"MovePose {name}_pose"
    assert grasps == [at, f"{at} + x_offset", f"{at} - x_offset"]


def test_a_centre_of_mass_takes_a_turn_with_the_object_and_one_before_it_is_taken():
    """The joints' friction is then left alike on the way up and down, with it and without; and where it hangs
    level, it turns least in the fingers meanwhile: a bar at first, a mallet at last."""

    def turns(thing: str, scene: Scene) -> tuple[str, list[int]]:
        done = actions(planned(scene, f"the mass and the centre of mass of the {thing}").tree)
        first, second = (i for i, action in enumerate(done) if action.startswith("Turn"))
        closed = done.index("CloseGripper", first)
        assert done[first - 1] == done[closed + 1] == f"{done[closed - 1]} + z_offset"
        assert closed < second < done.index("OpenGripper", closed)
        return done[closed - 1], [
            action for action in done[first:second] if action == "CloseGripper"
        ]

    assert turns("bar", bench(BAR)) == ("MovePose bar_pose", ["CloseGripper"])
    assert turns("mallet", bench(MALLET)) == ("MovePose mallet_balance", ["CloseGripper"])


def test_a_turn_takes_the_free_direction_and_is_left_out_without_one():
    def turns(*scene: str) -> list[str]:
        plan = planned(bench(*scene), "the balance point of the bar")
        assert plan.parameters
        message = "There is no room for Turn with 'bar'." in plan.explanation
        items = [action for action in actions(plan.tree) if action.startswith("Turn")]
        assert message == (not items)
        return items

    post, wall = '<geom type="box" size=".004 .004 .15"/>', '<geom type="box" size=".04 .004 .25"/>'
    assert turns(BAR) == ["Turn 90.0", "Turn 90.0"]
    item = f'<body name="post" pos="0.6 0.085 0.15">{post}</body>'
    assert turns(BAR, item) == ["Turn -90.0", "Turn -90.0"]
    walls = [f'<body name="wall{y}" pos="0.5 {y} 0.25">{wall}</body>' for y in (-0.125, 0.125)]
    assert turns(BAR, *walls) == []


MALLET = BAR.replace("bar", "mallet").replace(
    "</body>", '<geom type="box" pos=".125 0 .003" size=".015 .045 .018"/></body>'
)


def last_grasp(scene: Scene) -> str:
    """Where the plan for a mallet's mass and centre of mass takes it last."""
    done = actions(planned(scene, "the mass and the centre of mass of the mallet").tree)
    return [done[i - 1] for i, action in enumerate(done) if action == "CloseGripper"][-1]


def test_an_object_is_weighed_last_at_its_balance_point():
    assert last_grasp(bench(MALLET)) == "MovePose mallet_balance"
    message = planned(bench(MALLET), "the mass and the centre of mass of the mallet").explanation
    assert "'mallet' is grasped last at the balance point that the run estimates." in message


def test_the_balance_point_is_left_out_where_a_part_of_its_region_does_not_pass():
    blocked = bench(MALLET, BESIDE_ITS_END)
    assert last_grasp(blocked) == "MovePose mallet_pose + x_offset"


@pytest.mark.parametrize(("head", "last"), [("", "+"), ("-", "-")])
def test_the_plan_ends_with_a_grasp_at_the_heavier_side(head: str, last: str):
    """And so it is swung where an error of its centre of mass adds least to its inertia."""
    scene = parse_scene(f"""<mujoco><worldbody><site name="robot_base"/>
      <body name="table" pos="0.5 0 -0.03"><geom type="box" size=".3 .3 .03"/></body>
      <body name="mallet" pos="0.5 0 0.012"><freejoint/>
        <inertial pos="? ? ?" mass="?" diaginertia="? ? ?"/>
        <geom type="box" size=".13 .012 .012"/>
        <geom type="box" pos="{head}.145 0 0" size=".015 .045 .012"/></body>
    </worldbody></mujoco>""")
    plan = planned(scene, "the balance point and the inertia of the mallet")
    done = actions(plan.tree)
    grasps = [done[i - 1] for i, action in enumerate(done) if action == "CloseGripper"]
    assert grasps[-1] == f"MovePose mallet_pose {last} x_offset"
    swung = done.index("Swing")
    assert done[:swung].count("CloseGripper") == 3


def test_a_plan_without_a_request_measures_all_missing_values_only(scene: Scene):
    plan = planned(scene, None)
    assert set(plan.parameters) == set(scene.missing)
    assert plan.parameters[0] == parameters("bench.height")[0]
    assert not any("can_pose" in action for action in actions(plan.tree))


def test_a_known_quantity_is_not_measured_again_and_the_plan_says_so(scene: Scene):
    plan = planned(scene, "the masses of the bottle and the can")
    assert plan.parameters == parameters("bottle.mass")
    assert "0.2 kg" in plan.notes[0]
    assert planned(scene, "the mass of the can", remeasure=True).parameters == parameters(
        "can.mass"
    )


def test_when_all_is_known_there_is_nothing_to_do(scene: Scene):
    plan = SymbolicPlanner().plan("weigh the can", scene)
    assert (plan.parameters, plan.tree) == ((), None)
    assert "0.2 kg" in plan.explanation


@pytest.mark.parametrize(
    "request_", ["measure the water temperature", "the temperature of the bottle"]
)
def test_an_unmeasurable_quantity_gives_a_null_tree_with_an_explanation(
    scene: Scene, request_: str
):
    plan = SymbolicPlanner().plan(request_, scene)
    assert (plan.parameters, plan.tree) == ((), None)
    assert "cannot be measured" in plan.explanation
    assert check(plan, scene) == ()


def test_an_object_that_is_not_there_is_bad_input(scene: Scene):
    with pytest.raises(InputError, match="bottle"):
        SymbolicPlanner().plan("weigh the spoon", scene)


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (
            '<body name="thing" pos="0.5 0 0.08"><freejoint/><geom type="box" size=".06 .06 .08"/></body>',
            "wide",
        ),
        (
            '<body name="thing" pos="0.94 0.55 0.03"><freejoint/><geom type="box" size=".03 .03 .03"/></body>',
            "reach",
        ),
        (
            '<body name="thing" pos="0.5 0 0.03"><freejoint/><geom type="box" size=".05 .03 .03" mass="9"/></body>',
            "9 kg",
        ),
    ],
)
def test_an_infeasible_request_is_rejected_with_the_reason(body: str, reason: str):
    with pytest.raises(PlanRejected, match=reason):
        SymbolicPlanner().plan("the friction of the thing", bench(body))


def test_measurable_parameters_are_planned_in_spite_of_unmeasurable_ones():
    wide = '<body name="chest" pos="0.45 -0.3 0.08"><freejoint/><geom type="box" size=".06 .06 .08"/></body>'
    plan = planned(bench(BOTTLE, wide), "weigh the bottle and the chest")
    assert plan.parameters == parameters("bottle.mass")
    assert "chest" in plan.notes[0]


@pytest.mark.parametrize("where", ["0.5 0 0.09", "0.5 0.05 0.03"], ids=["on top", "beside"])
def test_a_blocking_object_is_carried_away_and_back(where: str):
    low = (
        '<body name="low" pos="0.5 0 0.03"><freejoint/><geom type="box" size=".05 .02 .03"/></body>'
    )
    other = f'<body name="other" pos="{where}"><freejoint/><geom type="box" size=".02 .02 .03" mass=".1"/></body>'
    plan = planned(bench(low, other), "How heavy is low?")
    done = actions(plan.tree)
    assert plan.parameters == parameters("low.mass")
    assert "'other' is in the way" in plan.explanation
    assert done.index("MovePose other_temporary") < done.index("MovePose low_pose")
    assert len(done) - done[::-1].index("MovePose other_pose") > len(done) - done[::-1].index(
        "MovePose low_pose"
    )


def test_position_velocity_and_momentum_are_chained_too(scene: Scene):
    request = (
        "the position of the bottle, the momentum of the crate and the velocity of the gripper"
    )
    plan = planned(scene, request, remeasure=True)
    assert plan.parameters == parameters("bottle.position", "crate.momentum", "gripper.velocity")


def test_the_same_request_gives_the_same_plan(scene: Scene):
    assert SymbolicPlanner().plan("weigh everything", scene) == SymbolicPlanner().plan(
        "weigh everything", scene
    )


def test_a_plan_for_fifteen_objects_is_fifteen_times_as_long_as_one_for_one():
    spots = [(x, y) for x in (0.36, 0.47, 0.58) for y in (-0.3, -0.15, 0.0, 0.15, 0.3)]
    item = '<body name="item{}" pos="{} {} 0.04"><freejoint/><geom type="cylinder" size=".025 .04"/></body>'
    crowd = bench(*(item.format(i, x, y) for i, (x, y) in enumerate(spots)))
    plan = planned(crowd, "weigh everything")
    assert plan.actions == 3 + 15 * 9


def test_an_obstacle_that_only_the_real_shape_shows_is_avoided_or_named() -> None:
    # The search looks at boxes of objects; a wall under the forearm is neither.
    wall = '<geom name="wall" type="box" pos="0.28 0 0.25" size=".01 .2 .25"/>'
    with pytest.raises(PlanRejected, match="'wall'"):
        SymbolicPlanner().plan("the mass of the bottle", bench(BOTTLE, wall))


FLAT = '<body name="tin" pos="0.45 0 0.42"><freejoint/><geom type="box" size=".03 .03 .02" friction=".5"/></body>'


def test_a_flat_object_is_put_back_onto_a_table_of_unknown_height() -> None:
    table = '<body name="table" pos="0.5 0 0.2"><geom type="box" size=".3 .3 ?"/></body>'
    scene = parse_scene(f"<mujoco><worldbody>{table}{FLAT}</worldbody></mujoco>")
    assert actions(planned(scene, "How heavy is the tin?").tree) == weigh("tin")


def test_a_refusal_says_why_and_advises_the_user() -> None:
    pan = """<mujoco><worldbody>
      <geom name="table" type="box" size=".3 .4 .1" pos=".5 0 .1"/>
      <body name="pan" pos=".5 0 .23"><freejoint/><geom type="box" size=".02 .02 .03" mass=".05"/>
        <geom type="cylinder" size=".1 .01" pos=".2 0 0"/></body></worldbody></mujoco>"""
    with pytest.raises(
        PlanRejected, match=r"from its centre of mass.*; place it so that"
    ) as result:
        SymbolicPlanner().plan("the mass of the pan", parse_scene(pan))
    assert "MovePose" not in str(result.value)


def test_the_baseline_probes_every_surface_and_weighs_and_slides_every_object() -> None:
    scene = bench(BOTTLE, MUG, KNOWN)
    plan = ExhaustivePlanner().plan("the mass of the bottle", scene)
    assert set(plan.parameters) == set(
        parameters(
            "bench.height",
            *(
                f"{name}.{quantity}"
                for name in ("bottle", "mug", "can")
                for quantity in ("mass", "friction")
            ),
        )
    )
    assert check(plan, scene, remeasure=True) == ()
    assert actions(plan.tree).count("MoveJoints home_config") == 2
    asked = SymbolicPlanner().plan("the mass of the bottle", scene)
    assert asked.actions == 12
    assert plan.actions >= 29


@pytest.mark.parametrize("quantity", ["com_3d", "inertia", "size"])
def test_a_name_of_several_words_is_as_good_as_any(quantity: str):
    """MuJoCo allows any name: what was recorded with the empty hand at its pose belongs to it, too."""
    names = ("mug", "red mug", "Glas (klein)")
    trees = []
    for name in names:
        scene = bench(MUG.replace('"mug"', f'"{name}"'))
        planner = SymbolicPlanner(measure=(Parameter(name, quantity),))
        tree = planner.plan(None, scene).tree
        trees.append(str(tree).replace(name, "mug"))
    assert "MoveJoints" in trees[0]
    assert trees[1:] == trees[:1] * 2


SEAM = """<mujoco><worldbody><site name="robot_base"/>{surfaces}
  <body name="cup" pos="0.5 0 0.27"><freejoint/><geom type="cylinder" size=".03 .05"/></body>
</worldbody></mujoco>"""
HALF = '<geom type="box" size=".3 {half} .02" pos="{x} {y} {z}" friction="{friction}"/>'
FRICTION = (Parameter("cup", "friction"),)


def seam(frictions: tuple[float, float], half: float = 0.25, one_body: bool = False) -> Scene:
    """A cup on the line where two boxes of these frictions meet, of one body or of two."""
    place = {"x": 0.0, "z": 0.0, "half": half}
    left, right = (
        HALF.format(**place, y=side * half, friction=friction)
        for side, friction in zip((1, -1), frictions, strict=True)
    )
    body = '<body name="{}" pos="0.5 0 0.2">{}</body>'
    parts = [("table", left + right)] if one_body else [("left", left), ("right", right)]
    return parse_scene(SEAM.format(surfaces="".join(body.format(*part) for part in parts)))


def recorded_slides(plan: Plan) -> list[str]:
    assert plan.tree is not None
    parallels = [node for _, node in plan.tree.walk() if node.type == "Parallel"]
    return [str(value) for node in parallels for _, value in node.children[0].args]


@pytest.mark.parametrize("one_body", [False, True])
def test_an_object_on_a_seam_is_slid_on_one_surface_and_put_back(one_body: bool):
    scene = seam((0.3, 0.6), one_body=one_body)
    plan = SymbolicPlanner(measure=FRICTION).plan(None, scene)
    assert check(plan, scene) == ()
    assert recorded_slides(plan)
    assert all(pose.startswith("cup_temporary ") for pose in recorded_slides(plan))
    assert "'cup' is on several surfaces and slides on one" in plan.explanation
    # Neither is it dragged back across the seam.
    back = [str(value) for _, node in plan.tree.walk() for _, value in node.args][-4:]
    assert back == ["cup_pose + z_offset", "cup_pose", "cup_pose + z_offset", "home_config"]


def test_a_surface_of_several_shapes_of_one_friction_is_one_surface():
    plan = SymbolicPlanner(measure=FRICTION).plan(None, seam((0.5, 0.5), one_body=True))
    assert all(pose.startswith("cup_pose ") for pose in recorded_slides(plan))


def test_friction_is_not_measured_without_room_on_one_surface():
    with pytest.raises(PlanRejected, match="on several surfaces, and none has free space"):
        SymbolicPlanner(measure=FRICTION).plan(None, seam((0.3, 0.6), half=0.025))
