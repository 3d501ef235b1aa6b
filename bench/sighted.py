"""Runs by sight alone: rendered scenes whose objects stand elsewhere than the scene says, found by their tags.

    python -m bench.sighted SEEDS [SCENARIO...] [--noise NAME] [--out FILE.jsonl]

Every object of a bundled scenario is moved by up to 20 mm and turned by up to 15°, and seen by a camera whose corners
have noise of 2 pixels, whose focal length is off by 1 % and whose place by 5 mm and 5 mrad (1 sigma). Contact
forces, falls and shoves are judged from MuJoCo's own state at every physics step.
"""

from __future__ import annotations

import argparse
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from unittest.mock import patch

import numpy as np

from bench.harm.judge import harm
from bench.photograph import take
from palpate.common.errors import PalpateError
from palpate.common.pose import Array, Pose
from palpate.execution.rehearsal import named_objects
from palpate.execution.simulated_cell import SimulatedCell, simulated_cell
from palpate.execution.witness import Witness
from palpate.perception.detection import Grey, detect
from palpate.perception.lens import Lens
from palpate.perception.look import Seen, look
from palpate.perception.rendered import Imperfections
from palpate.perception.solve import pose_difference
from palpate.robots.simulated.robot import MujocoRobot
from palpate.runs import pipeline
from palpate.runs.run import Run
from palpate.scene.load import parse_scene, replace_objects
from palpate.scene.scene import Scene
from palpate.studies.scenarios.catalogue import scenario
from palpate.studies.workers import Lines

SCENARIOS = (
    "one_missing_mass",
    "bottle_and_table",
    "hammer",
    "friction",
    "two_of_three",
    "clutter",
)
SHIFT, TURN = 0.020, np.radians(15.0)
"""m and rad that objects stand off at most, uniform."""
NOISE = 2.0
"""Pixels, 1 sigma, of each coordinate of a corner."""
FLAWS = Imperfections(focal=0.01, place=0.005, turn=0.005)
EYE = np.array([0.30, -0.35, 0.75])
"""m from the middle of the things to the camera."""
RADII, ROOM, APART = (0.2, 0.25, 0.3), 0.04, 0.11
"""m of tags on the table: from the middle of the things, from each of them, and between their edges."""
STREAM = 40
"""Random stream of the displacements, independent of all others of a seed."""


@dataclass(frozen=True, slots=True)
class Value:
    """A component of an estimate, and its truth."""

    name: str
    verdict: str
    truth: float
    value: float
    std: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class SightedRun:
    """Result of a run.

    Attributes:
        error: what ended it before anything moved.
        status, reason: of the run; reason of its stop.
        beyond: harm beyond the limits, in words.
        force: N, largest running mean over 10 ms of a contact.
        off: m, largest level error of a seen pose.
        seen: z, rms, of the poses that were seen; felt: of those of touched objects at the end.
        contradicted: objects whose pose touch contradicted.
        values: of the estimates.
    """

    scenario: str
    noise: str
    seed: int
    error: str = ""
    status: str = ""
    reason: str = ""
    beyond: tuple[str, ...] = ()
    force: float = 0.0
    off: float = 0.0
    seen: tuple[float, ...] = ()
    felt: tuple[float, ...] = ()
    contradicted: tuple[str, ...] = ()
    values: tuple[Value, ...] = ()


class WatchedCell(SimulatedCell):
    """Cell whose robot is watched from its first step."""

    witness: Witness
    made: MujocoRobot

    def robot(self) -> MujocoRobot:
        self.made = super().robot()
        self.witness = Witness.of(self.made.world)
        return self.made


def marked(text: str, scene: Scene) -> str:
    """A scene's MJCF with a tag on top of every object, three on the table, and a camera above."""
    root = ET.fromstring(text)
    bodies = {body.get("name"): body for body in root.iter("body")}
    middles = [body.pose_world.apply(body.centre) for body in scene.objects.values()]
    target = np.mean(middles, axis=0)
    for number, body in enumerate(scene.objects.values(), start=10):
        top = body.centre + np.array([0.0, 0.0, body.size[2] / 2 + 0.001])
        half = min(0.02, 0.45 * float(body.size[:2].min()))
        bodies[body.name].append(_tag(number, top, half))
    table = next(one for one in scene.surfaces.values() if one.carries)
    for number, spot in enumerate(_free_spots(scene, table.name, target)):
        at = table.pose_world.inverse().apply(np.array([*spot, table.top_z() + 0.001]))
        bodies[table.name].append(_tag(number, at, 0.03))
    back = EYE / np.linalg.norm(EYE)
    right = np.cross((0.0, 0.0, 1.0), back)
    right /= np.linalg.norm(right)
    axes = " ".join(f"{part:.6f}" for part in (*right, *np.cross(back, right)))
    eye = " ".join(f"{part:.6f}" for part in target + EYE)
    world = root.find("worldbody")
    assert world is not None
    ET.SubElement(world, "camera", name="over", pos=eye, xyaxes=axes, fovy="45")
    return ET.tostring(root, encoding="unicode")


def _tag(number: int, at: Array, half: float) -> ET.Element:
    place = " ".join(f"{part:.6f}" for part in at)
    return ET.Element("site", name=f"tag_{number}", pos=place, size=f"{half:.4f}")


def _free_spots(scene: Scene, table: str, target: Array) -> list[Array]:
    """Three places (2,) on a table beside the things, apart from each other."""
    found: list[Array] = []
    surface, bodies = scene.surfaces[table], scene.objects.values()
    for radius in RADII:
        for angle in np.radians(np.arange(0, 360, 30)):
            spot = target[:2] + radius * np.array([np.cos(angle), np.sin(angle)])
            away = [np.hypot(*(b.pose_world.position[:2] - spot)) - b.reach for b in bodies]
            away += [np.hypot(*(other - spot)) - APART for other in found]
            if min(away) > ROOM and surface.covers(*spot) and len(found) < 3:
                found.append(spot)
    return found


def displaced(text: str, scene: Scene, random: np.random.Generator) -> str:
    """A world's MJCF with every object of the scene elsewhere."""
    root = ET.fromstring(text)
    for body in root.iter("body"):
        if body.get("name") not in scene.objects:
            continue
        x, y, z = (float(part) for part in body.get("pos", "0 0 0").split())
        dx, dy = random.uniform(-SHIFT, SHIFT, 2)
        body.set("pos", f"{x + dx:.6f} {y + dy:.6f} {z}")
        turned = [float(part) for part in body.get("euler", "0 0 0").split()]
        turned[2] += float(np.degrees(random.uniform(-TURN, TURN)))
        body.set("euler", " ".join(f"{part:.4f}" for part in turned))
    return ET.tostring(root, encoding="unicode")


def seen_in(world: Scene, scene: Scene, seed: int, random: np.random.Generator) -> Seen:
    """What a camera sees of a world, by corners with noise."""
    picture = take(world.spec(), "over", seed=seed, imperfections=FLAWS)

    def noisy(grey: Grey, lens: Lens) -> list[tuple[int, Array]]:
        found = detect(grey, lens)
        return [(number, at + NOISE * random.standard_normal(at.shape)) for number, at in found]

    with patch("palpate.perception.detection.detect", noisy):
        return look(scene, [picture.pixels], picture.lens, picture.mount)


def judge(name: str, noise: str, seed: int) -> SightedRun:
    """One run, and what came of it."""
    random = np.random.default_rng([seed, STREAM])
    settings = scenario(name).settings(noise=noise, seed=seed)
    assert settings.scene is not None
    assert settings.world is not None
    folder, texts = (
        settings.scene.parent,
        [f.read_text("utf-8") for f in (settings.scene, settings.world)],
    )
    given = parse_scene(texts[0], folder)
    row = SightedRun(name, noise, seed)
    scene = parse_scene(marked(texts[0], given), folder)
    there = displaced(texts[1], given, random)
    world = parse_scene(marked(there, given), folder)
    try:
        seen = seen_in(world, scene, seed, random)
        if seen.unseen:
            return replace(row, error=f"not seen: {', '.join(seen.unseen)}")
        settings = replace(settings, world=None, scene=None).check_values(at_hand=True)
        believed = replace_objects(scene, seen.entries)
        made = simulated_cell(believed, world, noise=noise, seed=seed)
        cell = WatchedCell(made.world, noise=noise, seed=seed, scene=believed)
        run = pipeline.plan(settings, believed)
        if not run.ready:
            return replace(
                row, error="; ".join(f.message for f in run.findings) or run.plan.explanation
            )
        run = pipeline.estimate(pipeline.execute(run, cell), cell)
    except PalpateError as error:
        return replace(row, error=f"{type(error).__name__}: {error}")
    return _result(replace(row, off=_off(seen, world)), run, cell, seen, world)


def _off(seen: Seen, world: Scene) -> float:
    return max(
        float(np.linalg.norm((pose.position - world.body(name).pose_world.position)[:2]))
        for name, pose in seen.poses.items()
    )


def _z(pose: Pose, covariance: Array, truth: Pose) -> float:
    """Error of a position over what its covariance says, rms of three axes."""
    off = pose_difference(pose, truth)[:3]
    return float(np.sqrt(off @ np.linalg.solve(covariance[:3, :3], off) / 3))


def _result(row: SightedRun, run: Run, cell: WatchedCell, seen: Seen, world: Scene) -> SightedRun:
    judged = harm(cell.witness, named_objects(run.plan, run.scene))
    done = run.execution
    assert done is not None
    truths = {name: world.body(name).pose_world for name in seen.poses}
    felt = {name: belief for name, belief in run.beliefs.items() if belief.touches}
    ends = {name: cell.made.world.true_poses([name])[name] for name in felt}
    return replace(
        row,
        status=run.status,
        reason=done.stopped_by or "",
        beyond=judged.beyond,
        force=max((touch.mean10 for touch in judged.touches), default=0.0),
        seen=tuple(
            _z(pose, seen.covariances[name], truths[name]) for name, pose in seen.poses.items()
        ),
        felt=tuple(_z(b.pose, b.covariance, ends[name]) for name, b in felt.items()),
        contradicted=tuple(name for name, belief in felt.items() if belief.contradiction),
        values=tuple(_values(run)),
    )


def _values(run: Run) -> Iterator[Value]:
    for found in run.estimates:
        truth = run.truth.get(found.parameter)
        if truth is None or not found.has_value:
            continue
        columns = zip(found.values, found.stds, found.intervals, found.verdicts, strict=True)
        for i, (value, std, (low, high), verdict) in enumerate(columns):
            name = found.parameter.quantity + ("" if len(truth) == 1 else f" {'xyz'[i]}")
            yield Value(name, verdict, truth[i], *map(float, (value, std, low, high)))


def summary(rows: Sequence[SightedRun]) -> Iterator[str]:
    """Figures of the runs, a line each."""
    for name in dict.fromkeys(row.scenario for row in rows):
        here = [row for row in rows if row.scenario == name]
        counted = {
            status: sum(row.status == status for row in here)
            for status in ("complete", "failed", "aborted")
        }
        said = ", ".join(f"{count} {status}" for status, count in counted.items() if count)
        errors, harmed = sum(bool(row.error) for row in here), sum(bool(row.beyond) for row in here)
        force, off = max(row.force for row in here), 1e3 * max(row.off for row in here)
        yield (
            f"{name}: {len(here)} runs, {said}, {errors} not begun; {harmed} beyond a limit; largest force "
            f"{force:.1f} N; seen {off:.1f} mm off at most"
        )
    for kind in ("seen", "felt"):
        z = np.array([value for row in rows for value in getattr(row, kind)])
        if len(z):
            yield f"z of poses {kind}: {np.sqrt(np.mean(z**2)):.2f} over {len(z)}"
    values = [value for row in rows for value in row.values]
    for name in dict.fromkeys(value.name for value in values):
        sure = [one for one in values if one.name == name and one.verdict == "identified"]
        held = sum(one.low <= one.truth <= one.high for one in sure)
        z = np.array([(one.value - one.truth) / one.std for one in sure])
        rms = float(np.sqrt(np.mean(z**2))) if len(z) else np.nan
        count = sum(one.name == name for one in values)
        yield f"{name}: {count} values, {len(sure)} identified, {held} hold, z {rms:.2f}"


def main() -> None:
    """Execute what has no row yet, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", type=int)
    parser.add_argument("scenarios", nargs="*", default=SCENARIOS)
    parser.add_argument("--noise", default="measured")
    parser.add_argument("--out", type=Path, default=Path("sighted.jsonl"))
    asked = parser.parse_args()
    lines = Lines(asked.out)
    rows = {(row.scenario, row.noise, row.seed): row for row in lines.read_as(SightedRun)}
    for seed in range(asked.seeds):
        for name in asked.scenarios:
            key = (name, asked.noise, seed)
            if key not in rows:
                rows[key] = judge(*key)
                lines.add(asdict(rows[key]))
    for line in summary(list(rows.values())):
        print(line)


if __name__ == "__main__":
    main()
