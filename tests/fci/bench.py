"""A Franka in palpate's hidden world, put together from a scene."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.execution.simulated_cell import SimulatedCell, simulated_cell
from palpate.robots.owner import owner_arm, without_calibration_figures
from palpate.robots.simulated.noise.model import Streams
from palpate.robots.simulated.noise.models import noise_models
from palpate.robots.simulated.noise.true_arm import TrueArm
from palpate.scene.load import load_scene

from .believed import BelievedArm
from .hand import FrankaHand
from .plant import Fingers, Plant
from .robot import FrankaRobot
from .sensing import Sensing
from .server import Server
from .wire import ROBOT_VERSION


@dataclass(frozen=True)
class Setup:
    """What is served where.

    Attributes:
        scene: what the user knows, a file. world: the hidden world, a file; the scene itself with
            its unknowns drawn, by default. poses: where things are, a file.
        address: of both ports. q: joint angles to start at, rad; home by default.
        lockstep, pace, fastest: see `Server`; `fastest` 0: as fast as it goes. homed: the hand knows its opening.
        version: of the protocol that the arm speaks.
    """

    scene: str
    world: str | None = None
    poses: str | None = None
    noise: str = "lab"
    seed: int = 0
    visit: int = 0
    address: str = "127.0.0.1"
    lockstep: bool = True
    pace: float = 1.0
    fastest: float = 0.0
    q: list[float] | None = None
    homed: bool = True
    version: int = ROBOT_VERSION


class Workbench:
    """Everything behind the sockets."""

    def __init__(self, setup: Setup) -> None:
        poses = Path(setup.poses) if setup.poses else None
        scene = load_scene(Path(setup.scene), poses)
        world = Path(setup.world) if setup.world else None
        self.cell: SimulatedCell = simulated_cell(scene, world, noise=setup.noise, seed=setup.seed)
        noise = noise_models().load(setup.noise, scene.arm)
        streams = Streams(setup.seed, setup.visit)
        arm, truth = (
            without_calibration_figures(owner_arm(scene.arm, noise.datasheet)),
            TrueArm(noise.model, streams),
        )
        spec = self.cell.world.spec(self.cell.drawn)
        q = None if setup.q is None else np.array(setup.q)
        self.plant = Plant(spec, self.cell.world.pose_world_base, arm, truth, q)
        self.believed = BelievedArm(arm)
        self.sensing = Sensing(self.plant, self.believed, arm, noise, streams)
        fingers = Fingers(self.plant, arm, truth.width())
        self.hand = FrankaHand(fingers, setup.homed)
        self.robot = FrankaRobot(
            self.plant, self.believed, self.sensing, arm, fingers.command, setup.seed
        )
        self.server = Server(
            setup.address,
            self.robot,
            self.hand,
            lockstep=setup.lockstep,
            pace=setup.pace,
            fastest=setup.fastest or math.inf,
            version=setup.version,
        )
