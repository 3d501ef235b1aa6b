"""Worlds that differ from the scene: objects up to 20 mm off, posts and light objects that the scene
does not show."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bench.campaign.ledger import Drawn, Row, judged_run
from bench.faults.bases import bases
from bench.harm.judge import UNSEEN, TailFigures
from bench.harm.probe import probed_run
from palpate.common.pose import Pose
from palpate.runs import pipeline
from palpate.scene.load import rearrange, scene_from_text
from palpate.scene.scene import Scene
from palpate.studies.scenarios.catalogue import scenario

MOST = 0.020
"""m: largest displacement of an object from its pose in the scene."""
STIFFNESS = (1e4, 1e5, 1e6)
"""N/m of a post's contact with the arm."""
RIGID = 1e6
"""N/m: least stiffness of a rigid contact."""
POST_MASS = 1.0
"""kg; an aluminium post of this size has 0.8."""
CONTACT, CONTACT_DAMPING = 3e6, 1200.0
"""1/s^2 and 1/s of its contact: what physics steps of 0.5 ms resolve."""
CAUTIOUS = TailFigures(tail=25.0)
"""Limits of hidden things with a cautious arm: those of things of the scene, and the tail."""
CAUTIOUS_RIGID = TailFigures(mean10=80.0, tail=25.0)
"""As `CAUTIOUS`, for a contact stiffness of `RIGID` or more."""
POST = "hidden_post"
LIGHT_THING = "hidden_cup"


def meet(case: Drawn, blank: Row) -> Row:
    """Execute a valid plan in a world that differs from its scene.

    Kinds: `poses`, `obstacles`, `light`, and `cautious`: obstacles met by an arm that moves slowly,
    under the limits of shown things.
    """
    random = case.random(11)
    light = [base for base in bases() if base.light and base.world and base.scene.objects]
    base = light[int(random.integers(0, len(light)))]
    settings = scenario(base.name.partition(":")[0]).settings(cautious=case.kind == "cautious")
    scene = pipeline.load(settings)
    true = pipeline.load(replace(settings, scene=settings.world))
    assert scene is not None
    assert true is not None
    wrong = wrong_world(case.kind, true, random)
    seen = probed_run(
        base.plan,
        scene,
        wrong.world,
        "lab",
        case.number,
        unseen=wrong.unseen,
        hidden=wrong.figures,
    )
    row = judged_run(replace(blank, what=f"{base.name}: {wrong.what}"), seen)
    listed = [str(fate) for fate in seen.harm.unseen]
    return replace(row, figures={**row.figures, "base": base.name, "unseen": listed})


@dataclass(frozen=True, slots=True, eq=False)
class Wrong:
    """A hidden world that differs from the scene.

    Attributes:
        what: the difference, in words.
        unseen: names of bodies that the scene does not show.
        figures: limits of contact forces on these.
    """

    world: Scene
    what: str
    unseen: tuple[str, ...] = ()
    figures: TailFigures = UNSEEN


def wrong_world(kind: str, true: Scene, random: np.random.Generator) -> Wrong:
    """Draw the world of a case."""
    if kind == "poses":
        return Wrong(*_shifted(true, random))
    place = _on_the_way(true, random)
    if kind == "light":
        world = scene_from_text(_with(true.text, _cup(place)), true)
        return Wrong(world, f"a cup at {_at(place)}", (LIGHT_THING,))
    stiffness = STIFFNESS[int(random.integers(0, len(STIFFNESS)))]
    world = scene_from_text(_with(true.text, post(place, stiffness)), true)
    figures = UNSEEN
    if kind == "cautious":
        figures = CAUTIOUS_RIGID if stiffness >= RIGID else CAUTIOUS
    return Wrong(world, f"a post of {stiffness:.0e} N/m at {_at(place)}", (POST,), figures)


def _shifted(true: Scene, random: np.random.Generator) -> tuple[Scene, str]:
    """Displace every object by up to `MOST` on its surface."""
    shifts: list[str] = []
    poses: dict[str, Pose] = {}
    for name, body in true.objects.items():
        # The square root makes positions uniform over the disk.
        way, angle = MOST * np.sqrt(random.random()), random.uniform(0, 2 * np.pi)
        aside = way * np.array([np.cos(angle), np.sin(angle), 0.0])
        poses[name] = body.pose_world.translate(aside)
        shifts.append(f"{name} {1e3 * way:.0f} mm")
    return rearrange(true, poses), f"off: {', '.join(shifts)}"


def _on_the_way(true: Scene, random: np.random.Generator) -> tuple[float, float, float]:
    """Place (x, y, z of the table's top) near an object, or between the arm and it."""
    objects = list(true.objects.values())
    body = objects[int(random.integers(0, len(objects)))]
    at, base = body.pose_world.position, true.pose_world_base.position
    share = random.uniform(0.35, 1.25)
    aside = random.uniform(-0.15, 0.15)
    ahead = (at - base)[:2]
    across = np.array([-ahead[1], ahead[0]]) / max(float(np.linalg.norm(ahead)), 1e-6)
    spot = base[:2] + share * ahead + aside * across
    for other in objects:  # not inside one
        near = other.pose_world.position[:2]
        if np.linalg.norm(spot - near) < 0.10:
            spot = near + 0.10 * (spot - near) / max(float(np.linalg.norm(spot - near)), 1e-6)
    bottom = float(at[2] - body.size[2] / 2)
    return float(spot[0]), float(spot[1]), bottom


def post(place: tuple[float, float, float], stiffness: float) -> str:
    """MJCF of a post, 0.4 m high and 20 mm above the ground, with the contact stiffness `stiffness`,
    N/m, against any body."""
    x, y, z = place
    # The stiffness of a MuJoCo contact scales with the masses in it: `solref="-k -b"` gives k times
    # the effective mass (manual, solver parameters). So the post stands on springs, and its contact
    # is stiffer than these. A fifth of the critical damping, with 10 kg on it, leaves a rebound of
    # about one half.
    damping = 2 * 0.2 * np.sqrt(10.0 * stiffness)
    slides = "".join(
        f'<joint type="slide" axis="{axis}" stiffness="{stiffness}" damping="{damping}"/>'
        for axis in ("1 0 0", "0 1 0", "0 0 1")
    )
    return (
        f'<body name="{POST}" pos="{x} {y} {z + 0.21}" gravcomp="1">{slides}'
        f'<geom type="cylinder" size=".015 .19" mass="{POST_MASS}" priority="2" '
        f'solref="{-CONTACT} {-CONTACT_DAMPING}" solimp="0.99 0.99 0.001"/></body>'
    )


def _cup(place: tuple[float, float, float]) -> str:
    x, y, z = place
    return (
        f'<body name="{LIGHT_THING}" pos="{x} {y} {z + 0.061}"><freejoint/>'
        '<geom type="cylinder" size=".03 .06" mass=".1" friction="0.6 0.005 0.0001"/></body>'
    )


def _with(text: str, body: str) -> str:
    head, end, tail = text.rpartition("</worldbody>")
    return head + body + end + tail


def _at(place: tuple[float, float, float]) -> str:
    return f"({place[0]:.2f}, {place[1]:.2f})"
