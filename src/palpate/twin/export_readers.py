"""Experiments with a file in one simulator, run as a script in a separate process.

`python export_readers.py < job.json > result.json`. It imports nothing of palpate, so that the
interpreter of any environment can run it. The job has `reader`, `remedy`, `file`, `placement`,
`gravity`, m/s², `step` and `seconds`, s, and `experiments`: initial velocities of free bodies
(`velocity`, m/s) and of joints (`rate`), and forces at the centres of mass (`force`, N). The result
has `bodies` (mass, centre of mass and inertia about it in world axes) and for each experiment the
centres of mass and the joints' travels at its end.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

Job = dict[str, Any]
Bodies = dict[str, dict[str, Any]]
Placement = dict[str, dict[str, Any]]
"""By free body: `file`, `position` and `quaternion_xyzw` in the world."""


def load(module: str) -> Any:
    """Import a library without types."""
    return importlib.import_module(module)


def shorten(label: str) -> str:
    """Name of a body or joint without the path of its file or stage."""
    return label.rsplit("/", 1)[-1]


def facts(mass: float, com: Any, rotation: Any, inertia: Any) -> dict[str, Any]:
    """Facts of a body: inertia (3, 3) in axes that `rotation` (3, 3) turns into the world's."""
    world = np.asarray(rotation) @ np.asarray(inertia).reshape(3, 3) @ np.asarray(rotation).T
    return {"mass": float(mass), "com": np.ravel(com).tolist(), "inertia": world.ravel().tolist()}


def rotation_of(xyzw: Any) -> Any:
    """Rotation matrix (3, 3) of a unit quaternion."""
    x, y, z, w = np.asarray(xyzw, dtype=float)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross


def matrix(pose: list[float]) -> Any:
    """Homogeneous matrix (4, 4) of position and quaternion x y z w."""
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = rotation_of(pose[3:]), pose[:3]
    return transform


def separate(file: str, placement: Placement) -> Iterator[tuple[str, str, list[float]]]:
    """Yield name, path, and position and quaternion x y z w, of each separate file."""
    for name, at in placement.items():
        path = Path(file).with_name(at["file"])
        yield name, str(path), [*at["position"], *at["quaternion_xyzw"]]


def read_spec(mujoco: Any, file: str, placement: Placement) -> Any:
    """Read a file by MuJoCo, with separate URDF files of free bodies at their poses."""
    spec = mujoco.MjSpec.from_file(file)
    if not file.endswith(".urdf"):
        return spec
    spec.compiler.fusestatic, spec.compiler.discardvisual = False, True
    for name, path, pose in separate(file, placement):
        other = mujoco.MjSpec.from_file(path)
        other.compiler.fusestatic, other.compiler.discardvisual = False, True
        frame = spec.worldbody.add_frame(pos=pose[:3], quat=[pose[6], *pose[3:6]])
        frame.attach_body(other.worldbody.first_body(), f"{name}/", "").add_freejoint()
        # MuJoCo wants a prefix; all names are unique without it.
        for part in (*spec.bodies, *spec.joints):
            part.name = part.name.removeprefix(f"{name}/")
    return spec


def bodies_of(mujoco: Any, model: Any) -> Bodies:
    """Facts of all bodies of a compiled MuJoCo model in its initial configuration."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    bodies: Bodies = {}
    for body in range(1, model.nbody):
        inertia = np.diag(model.body_inertia[body])
        axes = data.ximat[body].reshape(3, 3)
        name = shorten(model.body(body).name)
        bodies[name] = facts(model.body_mass[body], data.xipos[body], axes, inertia)
    return bodies


class Reader:
    """A simulator with a loaded file.

    Attributes:
        package: distribution.
        step: s.
        joints: hinges and slides by name, as the simulator refers to them.
    """

    package: str
    step: float
    joints: dict[str, Any]

    def bodies(self) -> Bodies:
        raise NotImplementedError

    def reset(self) -> None:
        """Return to the initial state."""

    def launch(self, name: str, velocity: list[float]) -> None:
        """Give a free body a velocity, if it is one."""

    def kick(self, joint: Any, rate: float) -> None:
        """Give a joint a velocity."""

    def advance(self, steps: int, forces: dict[str, list[float]]) -> None:
        """Simulate with constant forces on bodies."""
        raise NotImplementedError

    def centres(self) -> dict[str, Any]:
        """Centres of mass of all bodies in the world."""
        return {}

    def travel(self, joint: Any) -> float:
        """Travel of a joint from its initial position."""
        raise NotImplementedError

    def run(self, experiment: Job, seconds: float) -> dict[str, Any]:
        """Run an experiment from the initial state."""
        self.reset()
        for name, velocity in experiment.get("velocity", {}).items():
            self.launch(name, velocity)
        for name, rate in experiment.get("rate", {}).items():
            if name in self.joints:
                self.kick(self.joints[name], rate)
        self.advance(round(seconds / self.step), experiment.get("force", {}))
        com = {name: np.ravel(at).tolist() for name, at in self.centres().items()}
        return {"com": com, "joints": {n: float(self.travel(j)) for n, j in self.joints.items()}}


class MuJoCo(Reader):
    """MuJoCo, from MJCF, URDF, or USD with the package mujoco-usd."""

    package = "mujoco"

    def __init__(self, job: Job) -> None:
        self.mj = load("mujoco")
        spec = read_spec(self.mj, job["file"], job["placement"])
        if job["file"].endswith(".urdf"):
            spec.option.gravity, spec.option.timestep = job["gravity"], job["step"]
        self.model = model = spec.compile()
        self.data, self.step = self.mj.MjData(model), model.opt.timestep
        self.names = {shorten(model.body(body).name): body for body in range(1, model.nbody)}
        slide = int(self.mj.mjtJoint.mjJNT_SLIDE)
        moving = [j for j in range(model.njnt) if model.jnt_type[j] >= slide]
        self.joints = {shorten(model.joint(j).name): j for j in moving}

    def bodies(self) -> Bodies:
        return bodies_of(self.mj, self.model)

    def reset(self) -> None:
        self.mj.mj_resetData(self.model, self.data)

    def launch(self, name: str, velocity: list[float]) -> None:
        dof = int(self.model.body_dofadr[self.names[name]]) if name in self.names else -1
        if dof >= 0:
            self.data.qvel[dof : dof + 3] = velocity

    def kick(self, joint: Any, rate: float) -> None:
        self.data.qvel[self.model.jnt_dofadr[joint]] = rate

    def advance(self, steps: int, forces: dict[str, list[float]]) -> None:
        for name, force in forces.items():
            if name in self.names:
                self.data.xfrc_applied[self.names[name], :3] = force
        self.mj.mj_forward(self.model, self.data)
        self.simulate(steps)
        self.mj.mj_forward(self.model, self.data)

    def simulate(self, steps: int) -> None:
        self.mj.mj_step(self.model, self.data, nstep=steps)

    def centres(self) -> dict[str, Any]:
        return {name: self.data.xipos[body] for name, body in self.names.items()}

    def travel(self, joint: Any) -> float:
        at = self.model.jnt_qposadr[joint]
        return float(self.data.qpos[at] - self.model.qpos0[at])


class Warp(MuJoCo):
    """MuJoCo Warp, one world, on the CPU or the graphics card."""

    package = "mujoco-warp"

    def simulate(self, steps: int) -> None:
        warp, mjw = load("warp"), load("mujoco_warp")
        warp.config.quiet = True
        model = mjw.put_model(self.model)
        data = mjw.put_data(self.model, self.data, nconmax=512, njmax=4096)
        for _ in range(steps):
            mjw.step(model, data)
        mjw.get_data_into(self.data, self.model, data)


class Newton(Reader):
    """Newton with its MuJoCo solver.

    `remedy`: the resolver of MuJoCo's attributes in USD, several contacts of round shapes, and room
    for all contacts.
    """

    package = "newton"

    def __init__(self, job: Job) -> None:
        warp = load("warp")
        warp.config.quiet = True
        self.newton, self.step = load("newton"), job["step"]
        self.solver = self.newton.solvers.SolverMuJoCo
        builder = self.newton.ModelBuilder(gravity=tuple(job["gravity"]))
        file, self.remedy = job["file"], job["remedy"]
        if file.endswith(".usdc") and self.remedy:
            self.solver.register_custom_attributes(builder)
            usd = load("newton.usd")
            resolvers = [usd.SchemaResolverMjc(), usd.SchemaResolverNewton()]
            builder.add_usd(file, schema_resolvers=resolvers)
            # The resolver reads springs from `mjc:stiffness`; the drive would add another one.
            builder.joint_target_ke = [0.0] * len(builder.joint_target_ke)
        elif file.endswith(".usdc"):
            builder.add_usd(file)
        elif file.endswith(".urdf"):
            builder.add_urdf(file, floating=False)
            for _, other, pose in separate(file, job["placement"]):
                builder.add_urdf(other, xform=warp.transform(*pose), floating=True)
        else:
            builder.add_mjcf(file)
        self.model = model = builder.finalize(device="cpu")
        model.set_gravity(tuple(job["gravity"]))
        self.labels = [shorten(label) for label in model.body_label]
        self.at, self.rates = model.joint_qd_start.numpy(), model.joint_qd.numpy().copy()
        kinds, children = self.newton.JointType, model.joint_child.numpy()
        types = model.joint_type.numpy()
        single = (int(kinds.REVOLUTE), int(kinds.PRISMATIC))
        named = enumerate(map(shorten, model.joint_label))
        self.joints = {name: j for j, name in named if types[j] in single}
        free = np.flatnonzero(types == int(kinds.FREE))
        self.free: dict[str, int] = {self.labels[children[j]]: int(j) for j in free}
        self.reset()

    def bodies(self) -> Bodies:
        masses, inertias = self.model.body_mass.numpy(), self.model.body_inertia.numpy()
        poses, bodies = self.state.body_q.numpy(), dict[str, dict[str, Any]]()
        for i, (name, com) in enumerate(self.centres().items()):
            bodies[name] = facts(masses[i], com, rotation_of(poses[i, 3:]), inertias[i])
        return bodies

    def reset(self) -> None:
        self.state, self.started = self.model.state(), self.rates.copy()
        model = self.model
        self.newton.eval_fk(model, model.joint_q, model.joint_qd, self.state)

    def launch(self, name: str, velocity: list[float]) -> None:
        if name in self.free:
            start = self.at[self.free[name]]
            self.started[start : start + 3] = velocity

    def kick(self, joint: Any, rate: float) -> None:
        self.started[self.at[joint]] = rate

    def advance(self, steps: int, forces: dict[str, list[float]]) -> None:
        model = self.model
        model.joint_qd.assign(self.started)
        # Without sizes it has room for few contacts, and drops the others with a printed line.
        sizes = {"nconmax": 1024, "njmax": 8192}
        options = {"enable_multiccd": True, **sizes} if self.remedy else {}
        solver = self.solver(model, **options)
        before, after, control = model.state(), model.state(), model.control()
        self.newton.eval_fk(model, model.joint_q, model.joint_qd, before)
        applied = np.zeros((model.body_count, 6), dtype=np.float32)
        for name, force in forces.items():
            if name in self.labels:
                applied[self.labels.index(name), :3] = force
        for _ in range(steps):
            before.body_f.assign(applied)
            solver.step(before, after, control, None, self.step)
            before, after = after, before
        self.state = before
        model.joint_qd.assign(self.rates)
        self.newton.eval_ik(model, before, before.joint_q, before.joint_qd)

    def centres(self) -> dict[str, Any]:
        poses, coms = self.state.body_q.numpy(), self.model.body_com.numpy()
        centres = [p[:3] + rotation_of(p[3:]) @ c for p, c in zip(poses, coms, strict=True)]
        return dict(zip(self.labels, centres, strict=True))

    def travel(self, joint: Any) -> float:
        at = int(self.model.joint_q_start.numpy()[joint])
        return float(self.state.joint_q.numpy()[at] - self.model.joint_q.numpy()[at])


class Drake(Reader):
    """Drake's MultibodyPlant.

    `remedy`: compliant hydroelastic contact; a point contact of two shapes has one point.
    """

    package = "drake"

    def __init__(self, job: Job) -> None:
        plants, self.step = load("pydrake.multibody.plant"), job["step"]
        self.algebra, builder = load("pydrake.multibody.math"), load("pydrake.systems.framework")
        builder = builder.DiagramBuilder()
        self.force = plants.ExternallyAppliedSpatialForce
        self.plant, graph = plants.AddMultibodyPlantSceneGraph(builder, time_step=self.step)
        if job["remedy"]:
            config = load("pydrake.geometry").SceneGraphConfig()
            config.default_proximity_properties.compliance_type = "compliant"
            config.default_proximity_properties.slab_thickness = 1.0
            graph.set_config(config)
        parser = load("pydrake.multibody.parsing").Parser(self.plant)
        parser.SetAutoRenaming(True)
        parser.AddModels(job["file"])
        placed = list(separate(job["file"], job["placement"]))
        for _, other, _ in placed:
            parser.AddModels(other)
        self.plant.mutable_gravity_field().set_gravity_vector(job["gravity"])
        self.plant.Finalize()
        for name, _, pose in placed:
            pose = load("pydrake.math").RigidTransform(matrix(pose))
            self.plant.SetDefaultFloatingBaseBodyPose(self.plant.GetBodyByName(name), pose)
        self.diagram = builder.Build()
        every: list[Any] = [self.plant.get_joint(j) for j in self.plant.GetJointIndices()]
        self.joints = {j.name(): j for j in every if j.num_velocities() == 1}
        instance = load("pydrake.multibody.tree").ModelInstanceIndex
        self.named: dict[str, Any] = {}
        for i in range(1, self.plant.num_model_instances()):
            for index in self.plant.GetBodyIndices(instance(i)):
                body = self.plant.get_body(index)
                self.named[body.name()] = body
        self.reset()

    def bodies(self) -> Bodies:
        bodies: Bodies = {}
        for (name, body), com in zip(self.named.items(), self.centres().values(), strict=True):
            inertia = body.CalcSpatialInertiaInBodyFrame(self.context)
            about = inertia.Shift(inertia.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
            axes = body.EvalPoseInWorld(self.context).rotation().matrix()
            bodies[name] = facts(body.get_mass(self.context), com, axes, about)
        return bodies

    def reset(self) -> None:
        self.simulator = load("pydrake.systems.analysis").Simulator(self.diagram)
        root = self.simulator.get_mutable_context()
        self.context = self.plant.GetMyMutableContextFromRoot(root)
        self.zero = self.plant.GetPositions(self.context).copy()

    def launch(self, name: str, velocity: list[float]) -> None:
        body = self.named.get(name)
        if body is not None and body.is_floating_base_body():
            twist = self.algebra.SpatialVelocity(np.zeros(3), np.array(velocity))
            self.plant.SetFreeBodySpatialVelocity(body, twist, self.context)

    def kick(self, joint: Any, rate: float) -> None:
        rates = self.plant.GetVelocities(self.context).copy()
        rates[joint.velocity_start()] = rate
        self.plant.SetVelocities(self.context, rates)

    def advance(self, steps: int, forces: dict[str, list[float]]) -> None:
        given: list[Any] = []
        for name, force in forces.items():
            if name in self.named:
                applied, body = self.force(), self.named[name]
                applied.body_index = body.index()
                applied.p_BoBq_B = body.CalcCenterOfMassInBodyFrame(self.context)
                applied.F_Bq_W = self.algebra.SpatialForce(np.zeros(3), np.array(force))
                given.append(applied)
        self.plant.get_applied_spatial_force_input_port().FixValue(self.context, given)
        self.simulator.AdvanceTo(steps * self.step)

    def centres(self) -> dict[str, Any]:
        centres: dict[str, Any] = {}
        for name, body in self.named.items():
            com = body.CalcCenterOfMassInBodyFrame(self.context)
            centres[name] = body.EvalPoseInWorld(self.context).multiply(com)
        return centres

    def travel(self, joint: Any) -> float:
        at = joint.position_start()
        return float(self.plant.GetPositions(self.context)[at] - self.zero[at])


class Bullet(Reader):
    """pybullet, with the inertias of the file, and the friction of joints as their motors'."""

    package = "pybullet"

    def __init__(self, job: Job) -> None:
        self.job, self.p, self.step = job, load("pybullet"), job["step"]
        self.p.connect(self.p.DIRECT)
        self.reset()

    def reset(self) -> None:
        p, file = self.p, self.job["file"]
        p.resetSimulation()
        p.setGravity(*self.job["gravity"])
        p.setTimeStep(self.step)
        flags = p.URDF_USE_INERTIA_FROM_FILE
        is_mjcf = file.endswith(".xml")
        robots = [] if is_mjcf else [p.loadURDF(file, useFixedBase=True, flags=flags)]
        robots += p.loadMJCF(file) if is_mjcf else ()
        for _, other, pose in separate(file, self.job["placement"]):
            robots.append(p.loadURDF(other, pose[:3], pose[3:], flags=flags))
        self.links: dict[str, tuple[int, int]] = {}
        self.joints = {}
        for robot in robots:
            self.links[p.getBodyInfo(robot)[0].decode()] = robot, -1
            for j in range(p.getNumJoints(robot)):
                info = p.getJointInfo(robot, j)
                self.links[info[12].decode()] = robot, j
                if info[2] in (p.JOINT_REVOLUTE, p.JOINT_PRISMATIC):
                    # Every joint has a motor that holds it: leave it the friction of the file.
                    p.setJointMotorControl2(robot, j, p.VELOCITY_CONTROL, force=info[7])
                    self.joints[info[1].decode()] = robot, j, p.getJointState(robot, j)[0]

    def frames(self) -> Iterator[tuple[str, tuple[int, int], Any, Any]]:
        """Yield name, reference, and position and quaternion of the frame of inertia."""
        for name, (robot, j) in self.links.items():
            if j < 0:
                at, turn = self.p.getBasePositionAndOrientation(robot)
            else:
                at, turn = self.p.getLinkState(robot, j, computeForwardKinematics=True)[:2]
            yield name, (robot, j), at, turn

    def bodies(self) -> Bodies:
        bodies: Bodies = {}
        for name, link, at, turn in self.frames():
            info = self.p.getDynamicsInfo(*link)
            bodies[name] = facts(info[0], at, rotation_of(turn), np.diag(info[2]))
        return bodies

    def launch(self, name: str, velocity: list[float]) -> None:
        robot, j = self.links.get(name, (-1, -1))
        if robot >= 0 and j < 0:
            self.p.resetBaseVelocity(robot, linearVelocity=velocity)

    def kick(self, joint: Any, rate: float) -> None:
        self.p.resetJointState(*joint, rate)

    def advance(self, steps: int, forces: dict[str, list[float]]) -> None:
        for _ in range(steps):
            for name, link, at, _ in self.frames() if forces else ():
                if name in forces:
                    self.p.applyExternalForce(*link, forces[name], at, self.p.WORLD_FRAME)
            self.p.stepSimulation()

    def centres(self) -> dict[str, Any]:
        return {name: at for name, _, at, _ in self.frames()}

    def travel(self, joint: Any) -> float:
        robot, j, start = joint
        return float(self.p.getJointState(robot, j)[0] - start)


class Pinocchio(Reader):
    """pinocchio: dynamics without contacts. Joints move by ABA with the friction of the model."""

    package = "pin"

    def __init__(self, job: Job) -> None:
        self.pin, self.step, file = load("pinocchio"), job["step"], job["file"]
        if file.endswith(".xml"):
            self.model = self.pin.buildModelFromMJCF(file)
        else:
            self.model = self.pin.buildModelFromUrdf(file)
            free = self.pin.JointModelFreeFlyer()
            for name, other, pose in separate(file, job["placement"]):
                body = self.pin.buildModelFromUrdf(other, free, f"{name}_free")
                place = self.pin.SE3(matrix(pose))
                self.model = self.pin.appendModel(self.model, body, 0, place)
        self.model.gravity.linear = np.array(job["gravity"])
        named = zip(self.model.names, self.model.joints, strict=True)
        self.joints = {str(name): joint for name, joint in named if joint.nv == 1}
        self.reset()

    def bodies(self) -> Bodies:
        pin, model, bodies = self.pin, self.model, dict[str, dict[str, Any]]()
        data = model.createData()
        pin.forwardKinematics(model, data, pin.neutral(model))
        for frame in model.frames:
            # The first body frame of a joint is its link; others are fixed to it.
            j = frame.parentJoint
            if frame.type == pin.FrameType.BODY and j and frame.placement.isIdentity(1e-9):
                pose, body = data.oMi[j], model.inertias[j]
                com = pose.act(body.lever)
                bodies.setdefault(frame.name, facts(body.mass, com, pose.rotation, body.inertia))
        return bodies

    def reset(self) -> None:
        self.q, self.v = self.pin.neutral(self.model), np.zeros(self.model.nv)

    def kick(self, joint: Any, rate: float) -> None:
        self.v[joint.idx_v] = rate

    def advance(self, steps: int, forces: dict[str, list[float]]) -> None:
        pin, model, data = self.pin, self.model, self.model.createData()
        friction = self.step * model.upperDryFrictionLimit
        for _ in range(steps if model.nv else 0):
            # Semi-implicit Euler; dry friction takes at most the whole momentum.
            push = -model.damping * self.v
            free: Any = self.v + self.step * pin.aba(model, data, self.q, self.v, push)
            upper: Any = np.triu(pin.crba(model, data, self.q))
            mass: Any = upper + np.triu(upper, 1).T
            drag: Any = friction * load("numpy").linalg.inv(mass).diagonal()
            self.v = np.sign(free) * np.maximum(np.abs(free) - drag, 0.0)
            self.q = pin.integrate(model, self.q, self.step * self.v)

    def travel(self, joint: Any) -> float:
        change = self.pin.difference(self.model, self.pin.neutral(self.model), self.q)
        return float(change[joint.idx_v])


READERS = {
    "mujoco": MuJoCo,
    "mujoco_warp": Warp,
    "newton": Newton,
    "drake": Drake,
    "pybullet": Bullet,
    "pinocchio": Pinocchio,
}


def run_job(job: Job) -> Job:
    """Run all experiments of a job."""
    reader = READERS[job["reader"]](job)
    answer: Job = {"version": version(reader.package), "bodies": reader.bodies()}
    answer["runs"] = {n: reader.run(e, job["seconds"]) for n, e in job["experiments"].items()}
    return answer


if __name__ == "__main__":
    # Libraries print, some of them from C: only the result goes to standard output.
    result = os.dup(1)
    os.dup2(2, 1)
    os.write(result, json.dumps(run_job(json.load(sys.stdin))).encode())
