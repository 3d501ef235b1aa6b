"""Recordings of the simulated arm on palpate's own motion for loads, at 1 kHz: with the empty hand, then with a load.

The true arm of a noise model moves by inverse dynamics (MuJoCo). A position controller that knows most of the load
leaves a small lag. The sensors and encoders of the noise model then measure.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path

import mujoco
import numpy as np

from palpate.common.pose import Array, Pose
from palpate.estimation.logs.excitation import Excitation, excitation
from palpate.estimation.rigid_bodies import tool_kinematics
from palpate.robots.nominal import NominalArm
from palpate.robots.owner import load_description
from palpate.robots.simulated.noise.disturbances import LoggedMotion
from palpate.robots.simulated.noise.model import Streams
from palpate.robots.simulated.noise.models import noise_models
from palpate.robots.simulated.noise.sensors import Encoders, Sensors
from palpate.robots.simulated.noise.true_arm import TrueArm
from palpate.robots.simulated.timing import BLOCK, PERIOD, TIMESTEP
from palpate.trace.recording import ArmLog
from palpate.trace.samples import STANDARD_GRAVITY

ARM = "fr3"
CYCLES = 2
"""Periods of the motion with the empty hand, and as many with the load."""
SECONDS = 24.0
"""s: duration of these periods."""
REST = 2.0
"""s at home before each motion; the hand grasps in the second one."""
UNKNOWN_SHARE = 0.1
"""Share of the load's weight that the controller does not know; its stiffness turns it into a lag."""
STIFFNESS = np.array([3000.0, 3000.0, 3000.0, 2500.0, 2500.0, 2000.0, 2000.0])
"""N m/rad: joint impedance defaults of libfranka."""
RUN = 8
"""Log periods that share one Jacobian in the sensors' model."""
GRAVITY: Array = np.array([0.0, 0.0, -STANDARD_GRAVITY])
LEVEL = np.array([0.45, 0.4, 0.3, 0.35, 0.35, 0.25, 0.2])
"""N m: its level. It is the mean of three real arms (docs/noise.md)."""
YIELDS = (4e-4, 1.2e-3, 2e-3, 6e-3)
"""rad at which each of its elements begins to slide."""
LOAD_SHARE, STRIBECK, SLOW, VISCOUS = 5e-3, 0.3, 0.05, 0.2
"""Its growth with the joint torque, and at low speed (below `SLOW`, rad/s); N m s/rad of viscous friction."""
GREASE_SHARE, GREASE_POWER, GREASE_VISCOUS = 0.02, 0.6, 0.5
"""Of `grease`: growth of the Coulomb friction with the joint torque; exponent of the speed; N m at 1 rad/s."""
WARMS, WARM_UP, UNEVEN = 0.3, 60.0, 0.15
"""Of `grease`: share of the friction that decays as the gears warm up, and its time, s; share that varies three times a
turn."""
REVERSES = 0.01
"""rad/s below which the friction of `grease` falls to zero."""
STREAM = 54
"""Random stream of the loads, independent of the arm's errors."""


@dataclass(frozen=True, slots=True)
class Case:
    """A recording: noise model, seed of the arm and of the load's shape, and mass, kg."""

    noise: str
    seed: int
    mass: float

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"{Path(self.noise).stem}-{self.seed}-{self.mass:g}"


@dataclass(frozen=True, slots=True, eq=False)
class Load:
    """A rigid load: mass, kg; centre (3,), m, from the TCP; and inertia (6,), kg m², about the centre.

    The axes are those of the tool; the inertia is xx yy zz xy xz yz.
    """

    mass: float
    com: Array
    inertia: Array


@dataclass(frozen=True, slots=True, eq=False)
class LoadedLog:
    """A recording, the window with the load, s, and the true load."""

    log: ArmLog
    window: tuple[float, float]
    load: Load


def cases(noises: list[str], seeds: range, masses: list[float]) -> Iterator[Case]:
    """Yield the recordings of a study."""
    for noise, seed, mass in product(noises, seeds, masses):
        yield Case(noise, seed, mass)


def drawn_load(case: Case) -> Load:
    """Draw a box of 40 to 160 mm an edge, up to 30 mm beside the TCP and 60 mm beyond it."""
    random = np.random.default_rng([STREAM, case.seed, round(1e3 * case.mass)])
    edges = random.uniform(0.04, 0.16, 3)
    squares = edges**2 / 12.0
    inertia = np.zeros(6)
    inertia[:3] = case.mass * (squares.sum() - squares)
    com = random.uniform([-0.03, -0.03, 0.0], [0.03, 0.03, 0.06])
    return Load(case.mass, com, inertia)


def recorded(case: Case, folder: Path | None = None) -> LoadedLog:
    """Simulate a recording, or read it from `folder` where it was saved before."""
    load, start = drawn_load(case), SECONDS + 2.0 * REST
    window = (start, start + SECONDS)
    file = None if folder is None else folder / f"{case.name}.npz"
    if file is not None and file.exists():
        data = np.load(file)
        log = ArmLog(*(data[name] for name in ("t", "q", "dq", "tau")), None, case.name)
        return LoadedLog(log, window, load)
    log = simulate(case, load)
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        np.savez(file, t=log.t, q=log.q, dq=log.dq, tau=log.tau)
    return LoadedLog(log, window, load)


@cache
def motion() -> Excitation:
    """Search for the motion of `palpate estimate --how`."""
    return excitation(load_description(ARM))


def simulate(case: Case, load: Load) -> ArmLog:
    """Simulate rest, motion, rest with a grasp, and motion with the load."""
    arm = load_description(ARM)
    model, streams = noise_models().load(case.noise, arm), Streams(case.seed)
    truth, sensors = TrueArm(model.model, streams), Sensors(model, arm.limits.tau_max, streams)
    encoders = Encoders(model, sensors.rests, streams)
    base = truth.base(Pose.of([0.0, 0.0, 0.0]))
    gravity = base.rotation.T @ truth.gravity(GRAVITY)
    # Commanded angles in log periods: both motions begin at the same phase.
    moved = motion().sample(PERIOD * np.arange(round(SECONDS / PERIOD)))[0]
    still = np.repeat(moved[:1], round(REST / PERIOD), axis=0)
    commanded = np.concatenate([still, moved, still, moved])
    held = np.arange(len(commanded)) >= len(commanded) - len(moved) - len(still) // 2
    # Torques behind the gears, with the lag of a controller that does not know all of the load.
    empty, loaded = (true_model(truth, gravity, each) for each in (None, load))
    weight = torques(loaded, commanded) - torques(empty, commanded)
    ramp = np.convolve(held, np.ones(20) / 20.0)[: len(held), None]
    q = commanded - UNKNOWN_SHARE * ramp * weight / STIFFNESS
    dq = np.gradient(q, PERIOD, axis=0)
    ddq = np.gradient(dq, PERIOD, axis=0)
    tau = np.where(held[:, None], torques(loaded, q, dq, ddq), torques(empty, q, dq, ddq))
    if law := LAWS.get(Path(case.noise).stem):
        tau += law(q, dq, tau)
    # Sensors are zeroed at home with the empty hand, and then measure run by run.
    nominal = NominalArm(arm, Pose.of([0.0, 0.0, 0.0]), GRAVITY).kinematics(q[:1])
    chain = arm.nominal.chain
    assert chain is not None
    position, _, jacobian = tool_kinematics(chain, q)
    sensors.line.kept = ()
    start = LoggedMotion(q[:1], dq[:1], jacobian[0], position[:1])
    sensors.zero(tau[0], nominal.gravity_torque[0], start)
    for first in range(0, len(q), RUN):
        rows = slice(first, first + RUN)
        last = min(first + RUN, len(q)) - 1
        sensors.measure(tau[rows], LoggedMotion(q[rows], dq[rows], jacobian[last], position[rows]))
    # Reported angles, and the rows of 1 kHz; a logged sample is the mean of a period.
    reported = encoders.reported(q, tau)
    noise = encoders.noise(len(q))
    reported = encoders.quantise_angles(reported if noise is None else reported + noise)
    rates = np.gradient(reported, PERIOD, axis=0)
    t = TIMESTEP * np.arange(len(q) * BLOCK)
    middle = PERIOD * np.arange(len(q)) + (BLOCK - 1) / 2.0 * TIMESTEP
    rows = (
        np.stack([np.interp(t, middle, column) for column in signal.T], axis=1)
        for signal in (reported, rates)
    )
    return ArmLog(t, *rows, np.concatenate(sensors.line.kept), None, case.name)


def maxwell_slip(q: Array, dq: Array, tau: Array) -> Array:
    """Compute the friction (n, 7), N m, of elastic elements in parallel, each with its own sliding distance.

    Source: F. Al-Bender, V. Lampaert and J. Swevers, The generalized Maxwell-slip model, IEEE TAC 50, 2005.
    """
    level = (LEVEL + LOAD_SHARE * np.abs(tau)) * (1.0 + STRIBECK * np.exp(-((dq / SLOW) ** 2)))
    yields = np.array(YIELDS)[:, None]
    stretch, shares = np.zeros((len(YIELDS), q.shape[1])), np.empty(q.shape)
    # Each element stretches with the motion up to its sliding distance.
    for row, step in enumerate(np.diff(q, axis=0, prepend=q[:1])):
        stretch = np.clip(stretch + step, -yields, yields)
        shares[row] = (stretch / yields).mean(axis=0)
    return level * shares + VISCOUS * dq


def grease(q: Array, dq: Array, tau: Array) -> Array:
    """Compute the friction (n, 7), N m, of greased gears: less than proportional to the speed, and less when warm.

    Source of the shape: A. Bittencourt and S. Gunnarsson, Static friction in a robot joint, J. Dyn. Syst. Meas.
    Control 134, 2012 (load, temperature); the sizes are chosen.
    """
    t = PERIOD * np.arange(len(q))[:, None]
    coulomb = (0.5 * LEVEL + GREASE_SHARE * np.abs(tau)) * (1.0 + UNEVEN * np.sin(3.0 * q))
    viscous = GREASE_VISCOUS * np.abs(dq) ** GREASE_POWER
    return (coulomb + viscous) * (1.0 + WARMS * np.exp(-t / WARM_UP)) * np.tanh(dq / REVERSES)


LAWS = {"strange": maxwell_slip, "greasy": grease}
"""Friction of the arm by the name of its noise model, of kinds that no estimator knows."""


def true_model(truth: TrueArm, gravity: Array, load: Load | None) -> mujoco.MjModel:
    """Compile the true arm, with a load that is fixed to its hand."""
    arm = load_description(ARM)
    spec = arm.spec(gravity)
    truth.build(spec, arm)
    if load is not None and load.mass > 0.0:
        site = spec.site(arm.tcp)
        spec.body(arm.hand.body).add_body(
            name="load",
            pos=site.pos,
            quat=site.quat,
            mass=load.mass,
            ipos=load.com,
            inertia=load.inertia[:3],
            explicitinertial=True,
        )
    model = spec.compile()
    # The sensors are behind the gears, and do not feel the motors' inertia.
    model.dof_armature[:] = 0.0
    return model


def torques(
    model: mujoco.MjModel, q: Array, dq: Array | None = None, ddq: Array | None = None
) -> Array:
    """Compute the torques (n, 7), N m, of a motion by MuJoCo's Newton-Euler recursion; at rest by default."""
    data, full, found = mujoco.MjData(model), np.empty(model.nv), np.empty(q.shape)
    data.qpos[7:] = load_description(ARM).hand.opening / 4
    for row in range(len(q)):
        data.qpos[:7] = q[row]
        if dq is not None and ddq is not None:
            data.qvel[:7], data.qacc[:7] = dq[row], ddq[row]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 1, full)
        found[row] = full[:7]
    return found
