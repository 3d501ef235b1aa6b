"""Experiments with a file in one simulator, run as a script in a process of its own.

`python export_readers.py < job.json > result.json`. It imports nothing of palpate, so that the
interpreter of any environment can run it. The job has `reader`, `file`, `gravity`, m/s², `step`, s,
`seconds`, `experiments` and `placement` (poses of separate URDF files). An experiment has initial
velocities of free bodies (`velocity`, m/s) and of joints (`rate`), and forces at the centres of
mass (`force`, N). The result has `bodies` (mass, centre of mass and inertia about it in world axes)
and, for each experiment, positions of the centres of mass and of the joints at its end.
"""

from __future__ import annotations

import importlib
import json
import os
import re
import sys
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

Job = dict[str, Any]
Positions = dict[str, dict[str, Any]]
Placement = dict[str, dict[str, Any]]
"""By body: `file`, `position` and `quaternion_xyzw` in the world."""


def load(module: str) -> Any:
    """Import a library without types."""
    return importlib.import_module(module)


def short(label: str) -> str:
    """Name of a body or joint without the path of its file or stage."""
    return label.rsplit("/", 1)[-1].rsplit("::", 1)[-1]


def facts(mass: float, com: Any, inertia: Any) -> dict[str, Any]:
    return {"mass": float(mass), "com": np.ravel(com).tolist(), "inertia": np.ravel(inertia).tolist()}


def rotation(xyzw: Any) -> Any:
    """Rotation matrix (3, 3) of a unit quaternion."""
    x, y, z, w = np.asarray(xyzw, dtype=float)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross


def matrix(pose: list[float]) -> Any:
    """Homogeneous matrix (4, 4) of position and quaternion x y z w."""
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = rotation(pose[3:]), pose[:3]
    return made


def separate(job: Job) -> Iterator[tuple[str, str, list[float]]]:
    """Yield name, path, and position and quaternion x y z w, of each separate file."""
    for name, at in job["placement"].items():
        path = Path(job["file"]).with_name(at["file"])
        yield name, str(path), [*at["position"], *at["quaternion_xyzw"]]


def read_spec(mujoco: Any, file: str, placement: Placement) -> Any:
    """Read a file by MuJoCo, with separate URDF files of free bodies at their poses."""
    spec = mujoco.MjSpec.from_file(file)
    if not file.endswith(".urdf"):
        return spec
    spec.compiler.fusestatic, spec.compiler.discardvisual = False, True
    for name, path, pose in separate({"file": file, "placement": placement}):
        other = mujoco.MjSpec.from_file(path)
        other.compiler.fusestatic, other.compiler.discardvisual = False, True
        frame = spec.worldbody.add_frame(pos=pose[:3], quat=[pose[6], *pose[3:6]])
        frame.attach_body(other.worldbody.first_body(), f"{name}/", "").add_freejoint()
        # MuJoCo wants a prefix; all names are unique without it.
        for part in (*spec.bodies, *spec.joints):
            part.name = part.name.removeprefix(f"{name}/")
    return spec


class MuJoCo:
    """MuJoCo, from MJCF, URDF, or USD with the package mujoco-usd."""

    package = "mujoco"

    def __init__(self, job: Job) -> None:
        self.mj = load("mujoco")
        spec = read_spec(self.mj, job["file"], job["placement"])
        if job["file"].endswith(".urdf"):
            spec.option.gravity, spec.option.timestep = job["gravity"], job["step"]
        self.model = spec.compile()
        self.data = self.mj.MjData(self.model)
        self.mj.mj_forward(self.model, self.data)

    def bodies(self) -> Positions:
        found: Positions = {}
        for body in range(1, self.model.nbody):
            axes = self.data.ximat[body].reshape(3, 3)
            inertia = axes @ np.diag(self.model.body_inertia[body]) @ axes.T
            mass = self.model.body_mass[body]
            found[short(self.model.body(body).name)] = facts(mass, self.data.xipos[body], inertia)
        return found

    def run(self, experiment: Job, seconds: float) -> Positions:
        mj, model, data = self.mj, self.model, self.data
        mj.mj_resetData(model, data)
        names = {short(model.body(body).name): body for body in range(model.nbody)}
        for name, velocity in experiment.get("velocity", {}).items():
            dof = int(model.body_dofadr[names[name]]) if name in names else -1
            if dof >= 0:
                data.qvel[dof : dof + 3] = velocity
        joints = {short(model.joint(j).name): j for j in range(model.njnt)}
        for name, rate in experiment.get("rate", {}).items():
            if name in joints:
                data.qvel[model.jnt_dofadr[joints[name]]] = rate
        for name, force in experiment.get("force", {}).items():
            if name in names:
                data.xfrc_applied[names[name], :3] = force
        self.step(round(seconds / model.opt.timestep))
        mj.mj_forward(model, data)
        angles: dict[str, float] = {}
        for name, j in joints.items():
            if model.jnt_type[j] >= int(mj.mjtJoint.mjJNT_SLIDE):
                address = model.jnt_qposadr[j]
                angles[name] = float(data.qpos[address] - model.qpos0[address])
        return {"com": {n: data.xipos[b].tolist() for n, b in names.items() if b}, "joints": angles}

    def step(self, steps: int) -> None:
        self.mj.mj_step(self.model, self.data, nstep=steps)


class Warp(MuJoCo):
    """MuJoCo Warp, one world, on the CPU or the graphics card."""

    package = "mujoco_warp"

    def step(self, steps: int) -> None:
        warp, mjw = load("warp"), load("mujoco_warp")
        warp.config.quiet = True
        self.mj.mj_forward(self.model, self.data)
        model = mjw.put_model(self.model)
        data = mjw.put_data(self.model, self.data, nconmax=512, njmax=4096)
        for _ in range(steps):
            mjw.step(model, data)
        mjw.get_data_into(self.data, self.model, data)


class Newton:
    """Newton with its MuJoCo solver. `remedy`: the schema resolvers for MuJoCo's attributes."""

    package = "newton"

    def __init__(self, job: Job) -> None:
        warp = load("warp")
        warp.config.quiet = True
        self.newton, self.wp = load("newton"), warp
        builder = self.newton.ModelBuilder(gravity=tuple(job["gravity"]))
        solver = self.newton.solvers.SolverMuJoCo
        file, options = job["file"], {}
        if file.endswith((".usdc", ".usda")):
            if job["remedy"]:
                solver.register_custom_attributes(builder)
                usd = load("newton.usd")
                resolvers = [usd.SchemaResolverMjc(), usd.SchemaResolverNewton()]
                options["schema_resolvers"] = resolvers
            builder.add_usd(file, **options)
        elif file.endswith(".urdf"):
            builder.add_urdf(file, floating=False)
            for _, other, pose in separate(job):
                builder.add_urdf(other, xform=warp.transform(*pose), floating=True)
        else:
            builder.add_mjcf(file)
        self.builder, self.step = builder, job["step"]
        self.model = builder.finalize(device="cpu")
        self.model.set_gravity(tuple(job["gravity"]))
        self.labels = [short(label) for label in self.model.body_label]

    def start(self) -> Any:
        state = self.model.state()
        self.newton.eval_fk(self.model, self.model.joint_q, self.model.joint_qd, state)
        return state

    def centres(self, state: Any) -> Any:
        poses, coms = state.body_q.numpy(), self.model.body_com.numpy()
        return [p[:3] + rotation(p[3:]) @ c for p, c in zip(poses, coms, strict=True)]

    def bodies(self) -> Positions:
        state = self.start()
        found: Positions = {}
        masses, inertias = self.model.body_mass.numpy(), self.model.body_inertia.numpy()
        for i, (name, com) in enumerate(zip(self.labels, self.centres(state), strict=True)):
            axes = rotation(state.body_q.numpy()[i, 3:])
            found[name] = facts(masses[i], com, axes @ inertias[i].reshape(3, 3) @ axes.T)
        return found

    def run(self, experiment: Job, seconds: float) -> Positions:
        model, newton = self.model, self.newton
        rates, starts = model.joint_qd.numpy().copy(), model.joint_qd_start.numpy()
        children, types = model.joint_child.numpy(), model.joint_type.numpy()
        joints: dict[str, int] = {}
        for j, label in enumerate(model.joint_label):
            if types[j] in (int(newton.JointType.REVOLUTE), int(newton.JointType.PRISMATIC)):
                joints[short(label)] = j
                if short(label) in experiment.get("rate", {}):
                    rates[starts[j]] = experiment["rate"][short(label)]
            body = self.labels[children[j]]
            if types[j] == int(newton.JointType.FREE) and body in experiment.get("velocity", {}):
                rates[starts[j] : starts[j] + 3] = experiment["velocity"][body]
        before = model.joint_qd.numpy().copy()
        model.joint_qd.assign(rates)
        solver = newton.solvers.SolverMuJoCo(model)
        state, after, control = self.start(), model.state(), model.control()
        forces = np.zeros((model.body_count, 6), dtype=np.float32)
        for name, force in experiment.get("force", {}).items():
            if name in self.labels:
                forces[self.labels.index(name), :3] = force
        for _ in range(round(seconds / self.step)):
            state.body_f.assign(forces)
            solver.step(state, after, control, None, self.step)
            state, after = after, state
        model.joint_qd.assign(before)
        newton.eval_ik(model, state, state.joint_q, state.joint_qd)
        at, coordinates = model.joint_q_start.numpy(), state.joint_q.numpy()
        zero = model.joint_q.numpy()
        angles = {name: float(coordinates[at[j]] - zero[at[j]]) for name, j in joints.items()}
        com = {n: c.tolist() for n, c in zip(self.labels, self.centres(state), strict=True)}
        return {"com": com, "joints": angles}


class Drake:
    """Drake's MultibodyPlant with point contact."""

    package = "drake"

    def __init__(self, job: Job) -> None:
        self.job, self.math = job, load("pydrake.math")
        self.build()

    def build(self) -> None:
        job, plants = self.job, load("pydrake.multibody.plant")
        framework, parsing = load("pydrake.systems.framework"), load("pydrake.multibody.parsing")
        builder = framework.DiagramBuilder()
        self.plant, _ = plants.AddMultibodyPlantSceneGraph(builder, time_step=job["step"])
        parser = parsing.Parser(self.plant)
        parser.SetAutoRenaming(True)
        parser.AddModels(job["file"])
        for _, other, _ in separate(job):
            parser.AddModels(other)
        self.plant.mutable_gravity_field().set_gravity_vector(job["gravity"])
        self.plant.Finalize()
        for name, _, pose in separate(job):
            body = self.plant.GetBodyByName(name)
            self.plant.SetDefaultFloatingBaseBodyPose(
                body, self.math.RigidTransform(matrix(pose))
            )
        self.diagram = builder.Build()

    def each(self) -> Any:
        indices = self.plant.GetBodyIndices
        count = self.plant.num_model_instances()
        instance = load("pydrake.multibody.tree").ModelInstanceIndex
        for i in range(1, count):
            for index in indices(instance(i)):
                yield self.plant.get_body(index)

    def bodies(self) -> Positions:
        context = self.plant.CreateDefaultContext()
        found: Positions = {}
        for body in self.each():
            inertia = body.CalcSpatialInertiaInBodyFrame(context)
            axes = body.EvalPoseInWorld(context).rotation().matrix()
            about = inertia.Shift(inertia.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
            com = body.CalcCenterOfMassInBodyFrame(context)
            centre = body.EvalPoseInWorld(context).multiply(com)
            found[body.name()] = facts(body.get_mass(context), centre, axes @ about @ axes.T)
        return found

    def run(self, experiment: Job, seconds: float) -> Positions:
        analysis, algebra = load("pydrake.systems.analysis"), load("pydrake.multibody.math")
        plants = load("pydrake.multibody.plant")
        simulator = analysis.Simulator(self.diagram)
        context = self.plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        forces: list[Any] = []
        for body in self.each():
            velocity = experiment.get("velocity", {}).get(body.name())
            if velocity is not None and body.is_floating_base_body():
                twist = algebra.SpatialVelocity(np.zeros(3), np.array(velocity))
                self.plant.SetFloatingBaseBodySpatialVelocity(context, body, twist) if hasattr(
                    self.plant, "SetFloatingBaseBodySpatialVelocity"
                ) else self.plant.SetFreeBodySpatialVelocity(body, twist, context)
            force = experiment.get("force", {}).get(body.name())
            if force is not None:
                applied = plants.ExternallyAppliedSpatialForce()
                applied.body_index = body.index()
                applied.p_BoBq_B = body.CalcCenterOfMassInBodyFrame(context)
                applied.F_Bq_W = algebra.SpatialForce(np.zeros(3), np.array(force))
                forces.append(applied)
        self.plant.get_applied_spatial_force_input_port().FixValue(context, forces)
        joints = {}
        for index in self.plant.GetJointIndices():
            joint = self.plant.get_joint(index)
            if joint.num_velocities() == 1 and joint.num_positions() == 1:
                joints[joint.name()] = joint
                rate = experiment.get("rate", {}).get(joint.name())
                if rate is not None:
                    at = joint.velocity_start()
                    rates = self.plant.GetVelocities(context).copy()
                    rates[at] = rate
                    self.plant.SetVelocities(context, rates)
        starts = self.plant.GetPositions(context).copy()
        simulator.AdvanceTo(seconds)
        ends = self.plant.GetPositions(context)
        at = {name: joint.position_start() for name, joint in joints.items()}
        angles = {name: float(ends[i] - starts[i]) for name, i in at.items()}
        com = {}
        for body in self.each():
            centre = body.CalcCenterOfMassInBodyFrame(context)
            com[body.name()] = body.EvalPoseInWorld(context).multiply(centre).tolist()
        return {"com": com, "joints": angles}


class Bullet:
    """pybullet, with the inertias of the file."""

    package = "pybullet"

    def __init__(self, job: Job) -> None:
        self.job, self.p = job, load("pybullet")
        self.p.connect(self.p.DIRECT)
        self.load()

    def load(self) -> None:
        p, job = self.p, self.job
        p.resetSimulation()
        p.setGravity(*job["gravity"])
        p.setTimeStep(job["step"])
        flags = p.URDF_USE_INERTIA_FROM_FILE | p.URDF_MAINTAIN_LINK_ORDER
        self.links: dict[str, tuple[int, int]] = {}
        self.joints: dict[str, tuple[int, int]] = {}
        robots: list[tuple[int, str]] = []
        if job["file"].endswith(".xml"):
            robots += [(robot, "") for robot in p.loadMJCF(job["file"])]
        else:
            robots.append((p.loadURDF(job["file"], useFixedBase=True, flags=flags), ""))
        for name, other, pose in separate(job):
            robot = p.loadURDF(other, pose[:3], pose[3:], flags=flags)
            robots.append((robot, name))
        for robot, _ in robots:
            self.links[p.getBodyInfo(robot)[0].decode()] = (robot, -1)
            for j in range(p.getNumJoints(robot)):
                info = p.getJointInfo(robot, j)
                self.links[info[12].decode()] = (robot, j)
                if info[2] in (p.JOINT_REVOLUTE, p.JOINT_PRISMATIC):
                    self.joints[info[1].decode()] = (robot, j)
                    # Replace the motor that brakes every joint by the friction of the file.
                    friction = info[7]
                    p.setJointMotorControl2(robot, j, p.VELOCITY_CONTROL, force=friction)

    def centre(self, robot: int, link: int) -> tuple[Any, Any]:
        """Position and quaternion of the frame of inertia."""
        if link < 0:
            return self.p.getBasePositionAndOrientation(robot)
        return self.p.getLinkState(robot, link, computeForwardKinematics=True)[:2]

    def bodies(self) -> Positions:
        found: Positions = {}
        for name, (robot, link) in self.links.items():
            at, turn = self.centre(robot, link)
            told = self.p.getDynamicsInfo(robot, link)
            axes = rotation(turn)
            found[name] = facts(told[0], at, axes @ np.diag(told[2]) @ axes.T)
        return found

    def run(self, experiment: Job, seconds: float) -> Positions:
        p = self.p
        self.load()
        for name, velocity in experiment.get("velocity", {}).items():
            robot, link = self.links.get(name, (-1, 0))
            if link < 0 <= robot:
                p.resetBaseVelocity(robot, linearVelocity=velocity)
        starts = {n: p.getJointState(*at)[0] for n, at in self.joints.items()}
        for name, rate in experiment.get("rate", {}).items():
            if name in self.joints:
                p.resetJointState(*self.joints[name], starts[name], rate)
        for _ in range(round(seconds / self.job["step"])):
            for name, force in experiment.get("force", {}).items():
                if name in self.links:
                    robot, link = self.links[name]
                    at = self.centre(robot, link)[0]
                    p.applyExternalForce(robot, link, force, at, p.WORLD_FRAME)
            p.stepSimulation()
        angles = {n: p.getJointState(*at)[0] - starts[n] for n, at in self.joints.items()}
        com = {n: list(self.centre(*at)[0]) for n, at in self.links.items()}
        return {"com": com, "joints": angles}


class Pinocchio:
    """pinocchio: rigid-body dynamics without contacts. Joint damping and friction act in ABA here only
    as the caller adds them.
    """

    package = "pin"

    def __init__(self, job: Job) -> None:
        self.pin, self.job = load("pinocchio"), job
        if job["file"].endswith(".xml"):
            self.model = self.pin.buildModelFromMJCF(job["file"])
        else:
            self.model = self.pin.buildModelFromUrdf(job["file"])
            for name, other, pose in separate(job):
                body = self.pin.buildModelFromUrdf(other, self.pin.JointModelFreeFlyer(), f"{name}_free")
                place = self.pin.SE3(matrix(pose))
                self.model = self.pin.appendModel(self.model, body, 0, place)
        self.model.gravity.linear = np.array(job["gravity"])

    def bodies(self) -> Positions:
        pin, model = self.pin, self.model
        data = model.createData()
        pin.forwardKinematics(model, data, pin.neutral(model))
        found: Positions = {}
        for frame in model.frames:
            # The first body frame of a joint is its link; others are fixed to it.
            j = frame.parentJoint
            if frame.type == pin.FrameType.BODY and j and frame.placement.isIdentity(1e-9):
                pose, held = data.oMi[j], model.inertias[j]
                inertia = pose.rotation @ held.inertia @ pose.rotation.T
                found.setdefault(frame.name, facts(held.mass, pose.act(held.lever), inertia))
        return found

    def run(self, experiment: Job, seconds: float) -> Positions:
        pin, model, step = self.pin, self.model, self.job["step"]
        if "rate" not in experiment:
            return {"com": {}, "joints": {}}
        data, q, v = model.createData(), pin.neutral(model), np.zeros(model.nv)
        start = q.copy()
        joints = {model.names[j]: model.joints[j] for j in range(1, model.njoints)}
        joints = {name: joint for name, joint in joints.items() if joint.nv == 1}
        for name, rate in experiment["rate"].items():
            if name in joints:
                v[joints[name].idx_v] = rate
        # Semi-implicit Euler, with the damping and friction that the file gave the model.
        friction = getattr(model, "upperDryFrictionLimit", np.zeros(model.nv))
        for _ in range(round(seconds / step)):
            free = v + step * pin.aba(model, data, q, v, -model.damping * v)
            pin.crba(model, data, q)
            inverse = np.diag(np.linalg.inv(data.M + np.triu(data.M, 1).T))
            v = np.sign(free) * np.maximum(np.abs(free) - step * friction * inverse, 0.0)
            q = pin.integrate(model, q, step * v)
        moved = pin.difference(model, start, q)
        return {"com": {}, "joints": {n: float(moved[j.idx_v]) for n, j in joints.items()}}


READERS: dict[str, Any] = {
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
    found: Job = {"version": version(re.sub("_", "-", reader.package)), "bodies": reader.bodies()}
    found["runs"] = {n: reader.run(e, job["seconds"]) for n, e in job["experiments"].items()}
    return found


if __name__ == "__main__":
    # Libraries print, some of them from C: only the result goes to standard output.
    result = os.dup(1)
    os.dup2(2, 1)
    os.write(result, json.dumps(run_job(json.load(sys.stdin))).encode())
