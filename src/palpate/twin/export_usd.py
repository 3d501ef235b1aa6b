"""USD of a model by `mujoco-usd-converter`, completed for the readers of USD."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from importlib.metadata import distributions
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from palpate.common.errors import Unavailable

WORLD = "world"
SCENE_PRIM = "PhysicsScene"
"""Name of the prim of the options, where the converter writes none."""


def require_usd() -> None:
    """Require the converter to USD. Raises Unavailable: it is not installed."""
    try:
        _module("mujoco_usd_converter")
    except ImportError as error:
        names = {str(each.metadata["Name"]).lower() for each in distributions()}
        if {"usd-core", "usd-exchange"} <= names:
            # Both install the module pxr: the last one wins.
            raise Unavailable(
                "USD needs usd-exchange, and usd-core shadows it: pip uninstall usd-core, then "
                "pip install --force-reinstall --no-deps usd-exchange"
            ) from None
        raise Unavailable(
            f"USD needs a converter ({error.name} is not installed): pip install 'palpate[export]', "
            "on Python 3.11 or 3.12"
        ) from None


def _module(name: str) -> Any:
    """Load a module of the extra at its first use. USD has no types."""
    return importlib.import_module(name)


def write_usd(spec: mujoco.MjSpec, mjcf: Path, folder: Path, static: Mapping[str, float]) -> Path:
    """Convert a model into one `.usdc`. It is first written as `mjcf`, in the folder of its files.

    `static` is the measured static friction by body.
    """
    mjcf.write_text(spec.to_xml(), encoding="utf-8")
    diagnostics = _module("usdex.core")
    diagnostics.activateDiagnosticsDelegate()
    diagnostics.setDiagnosticsLevel(diagnostics.DiagnosticsLevel.eError)
    converter = _module("mujoco_usd_converter").Converter(layer_structure=False)
    written = converter.convert(str(mjcf), str(folder.resolve()))
    file = folder / Path(str(written.path)).name
    state_physics(file, spec.compile(), static)
    return file


def state_physics(file: Path, model: mujoco.MjModel, static: Mapping[str, float]) -> None:
    """State in a stage what the converter leaves to the defaults of each reader.

    Args:
        file: converted stage, which is changed.
        model: from which it was converted.
        static: measured static friction by body.
    """
    physics, shade = _module("pxr.UsdPhysics"), _module("pxr.UsdShade")
    stage = _module("pxr.Usd").Stage.Open(str(file))
    prims = list(stage.Traverse())
    state_options(stage, model)
    # MuJoCo reads the binding for all purposes; renderers prefer those of their own purposes.
    for prim in prims:
        if prim.HasAPI(physics.CollisionAPI):
            binding = shade.MaterialBindingAPI(prim)
            material, _ = binding.ComputeBoundMaterial("physics")
            shown = binding.GetDirectBinding().GetMaterial()
            if not material:
                continue
            if shown and shown.GetPath() != material.GetPath():
                for purpose in ("full", "preview"):
                    binding.Bind(shown, materialPurpose=purpose)
            binding.Bind(material)
            # Static friction: measured, else that of sliding. The schema's default is 0.
            friction = physics.MaterialAPI(material)
            sliding = float(friction.GetDynamicFrictionAttr().Get())
            stated = float(friction.GetStaticFrictionAttr().Get() or 0.0)
            static_friction = max(static.get(owner_name(prim), 0.0), sliding, stated)
            friction.CreateStaticFrictionAttr(static_friction)
        elif prim.HasAPI(physics.RigidBodyAPI) and owner_name(prim) == WORLD:
            # Newton refuses fixed joints outside of articulations.
            below = list(_module("pxr.Usd").PrimRange(prim))[1:]
            is_tree = any(other.HasAPI(physics.RigidBodyAPI) for other in below)
            if is_tree and not any(o.HasAPI(physics.ArticulationRootAPI) for o in (prim, *below)):
                physics.ArticulationRootAPI.Apply(prim)
        elif prim.IsA(physics.RevoluteJoint) or prim.IsA(physics.PrismaticJoint):
            state_joint(prim, model)
    # The converter must have kept every mass.
    kept = {name_of(p): physics.MassAPI(p).GetMassAttr().Get() for p in stage.Traverse()}
    for body in range(1, model.nbody):
        mass, given = float(model.body_mass[body]), kept.get(model.body(body).name)
        if mass and not np.isclose(given or 0.0, mass, rtol=1e-5):
            raise ValueError(f"the mass of '{model.body(body).name}' is {given}, not {mass:.8g} kg")
    stage.GetRootLayer().Save()


def state_options(stage: Any, model: mujoco.MjModel) -> None:
    """State gravity, time step and every flag: the defaults of the schemas differ by version."""
    physics, types = _module("pxr.UsdPhysics"), _module("pxr.Sdf").ValueTypeNames
    scenes = [prim for prim in stage.Traverse() if prim.IsA(physics.Scene)]
    root = stage.GetDefaultPrim().GetPath()
    scene = scenes[0] if scenes else physics.Scene.Define(stage, root.AppendChild(SCENE_PRIM))
    scene = physics.Scene(scene)
    size = float(np.linalg.norm(model.opt.gravity))
    scene.CreateGravityMagnitudeAttr(size)
    if size > 0.0:
        scene.CreateGravityDirectionAttr(tuple((model.opt.gravity / size).tolist()))
    prim = scene.GetPrim()
    prim.AddAppliedSchema("MjcSceneAPI")
    step = prim.CreateAttribute("mjc:option:timestep", types.Double, False)
    step.Set(float(model.opt.timestep))
    # Names of flags follow those of MuJoCo's bits: mjDSBL_MULTICCD disables `mjc:flag:multiccd`.
    for bits, kind, on in (
        (model.opt.disableflags, mujoco.mjtDisableBit, False),
        (model.opt.enableflags, mujoco.mjtEnableBit, True),
    ):
        for name, bit in kind.__members__.items():
            if not name.startswith("mjN"):
                flag = f"mjc:flag:{name.partition('_')[2].lower()}"
                flagged = bool(int(bits) & int(bit))
                prim.CreateAttribute(flag, types.Bool, False).Set(flagged is on)


def state_joint(prim: Any, model: mujoco.MjModel) -> None:
    """State passive forces of a joint for Newton and PhysX; the converter does so for MuJoCo.

    Sources: `NewtonJointAPI` of newton-usd-schemas 0.6, `PhysxJointAxisAPI` of PhysX 5.6, and
    `PhysicsDriveAPI`. They state the damping and stiffness of a hinge per degree.
    """
    types = _module("pxr.Sdf").ValueTypeNames
    joint = int(model.joint(name_of(prim)).id)
    dof = int(model.jnt_dofadr[joint])
    is_hinge = model.jnt_type[joint] == int(mujoco.mjtJoint.mjJNT_HINGE)
    axis, degree = ("angular", np.pi / 180.0) if is_hinge else ("linear", 1.0)
    damping = float(model.dof_damping[dof]) * degree
    friction, armature = float(model.dof_frictionloss[dof]), float(model.dof_armature[dof])
    prim.AddAppliedSchema("NewtonJointAPI")
    prim.AddAppliedSchema(f"PhysxJointAxisAPI:{axis}")
    stated = {
        "newton:armature": armature,
        "newton:damping": damping,
        "newton:friction": friction,
        f"physxJointAxis:{axis}:armature": armature,
        f"physxJointAxis:{axis}:staticFrictionEffort": friction,
        f"physxJointAxis:{axis}:dynamicFrictionEffort": friction,
        f"physxJointAxis:{axis}:viscousFrictionCoefficient": damping,
    }
    for name, value in stated.items():
        prim.CreateAttribute(name, types.Float, False).Set(value)
    # A spring is a drive towards its rest.
    if model.jnt_stiffness[joint]:
        drive = _module("pxr.UsdPhysics").DriveAPI.Apply(prim, axis)
        at = model.jnt_qposadr[joint]
        drive.CreateStiffnessAttr(float(model.jnt_stiffness[joint]) * degree)
        drive.CreateTargetPositionAttr(float(model.qpos_spring[at] - model.qpos0[at]) / degree)


def iter_left_out(spec: mujoco.MjSpec) -> Iterator[str]:
    """Note the elements that the converter leaves out, by kind."""
    kinds = {
        "cameras": spec.cameras,
        "lights": spec.lights,
        "keyframes": spec.keys,
        "flexible things": spec.flexes,
        "skins": spec.skins,
        "contact pairs": spec.pairs,
        "sensors": spec.sensors,
    }
    for kind, elements in kinds.items():
        if elements:
            yield f"{len(elements)} {kind} are left out"


def name_of(prim: Any) -> str:
    """MuJoCo's name of a prim. USD's own names allow fewer characters."""
    return str(prim.GetDisplayName() or prim.GetName())


def owner_name(prim: Any) -> str:
    """Name of the nearest rigid body above a shape, or of the world."""
    owner = prim.GetParent()
    while owner and not owner.IsPseudoRoot():
        if owner.HasAPI(_module("pxr.UsdPhysics").RigidBodyAPI):
            return name_of(owner)
        owner = owner.GetParent()
    return WORLD
