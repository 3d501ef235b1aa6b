"""OpenUSD of a model: `mujoco-usd-converter` writes it (UsdPhysics, with MuJoCo's and Newton's own
schemas where that has no word), and it is read again here, with USD itself."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from palpate.errors import Unavailable
from palpate.geometry.pose import Array
from palpate.twin.export.facts import (
    CORNERS,
    WORLD,
    Facts,
    around,
    plane_box,
    round_box,
    tensor,
)


def require_usd() -> None:
    """Require the converter.

    Raises:
        Unavailable: it is not installed.
    """
    try:
        _module("mujoco_usd_converter")
    except ImportError as error:
        raise Unavailable(
            f"USD needs a converter ({error.name} is not installed): pip install 'palpate[export]', "
            "on Python 3.11 or 3.12"
        ) from None


def _module(name: str) -> Any:
    """A module of the extra, loaded when it is used; USD has no types."""
    return importlib.import_module(name)


def write_usd(spec: mujoco.MjSpec, mjcf: Path, folder: Path) -> Path:
    """Convert a model, which is first written as `mjcf` beside its files, into one `.usdc`."""
    mjcf.write_text(spec.to_xml(), encoding="utf-8")
    diagnostics = _module("usdex.core")
    diagnostics.activateDiagnosticsDelegate()
    diagnostics.setDiagnosticsLevel(diagnostics.DiagnosticsLevel.eError)
    converter = _module("mujoco_usd_converter").Converter(layer_structure=False)
    written = converter.convert(str(mjcf), str(folder.resolve()))
    return folder / Path(str(written.path)).name


def left_behind(spec: mujoco.MjSpec) -> Iterator[str]:
    """Notes on elements that the converter leaves out, by kind."""
    kinds = {
        "cameras": spec.cameras,
        "lights": spec.lights,
        "keyframes": spec.keys,
        "flexible things": spec.flexes,
        "skins": spec.skins,
        "contact pairs": spec.pairs,
        "sensors": spec.sensors,
    }
    for kind, things in kinds.items():
        if things:
            yield f"{len(things)} {kind} are left out"


def read_usd(path: Path) -> dict[str, Facts]:
    """Facts about a stage's rigid bodies and colliders."""
    geometry, physics = _module("pxr.UsdGeom"), _module("pxr.UsdPhysics")
    stage = _module("pxr.Usd").Stage.Open(str(path))
    shapes: dict[str, list[Array]] = {WORLD: []}
    frictions: dict[str, list[float]] = {WORLD: []}
    bodies: dict[str, Any] = {}
    for prim in stage.Traverse():
        if prim.HasAPI(physics.RigidBodyAPI):
            bodies[name_of(prim)] = prim
            shapes[name_of(prim)], frictions[name_of(prim)] = [], []
        elif prim.IsA(geometry.Gprim) and not is_guide(prim):
            owner = prim.GetParent()
            while owner and not (owner.IsPseudoRoot() or owner.HasAPI(physics.RigidBodyAPI)):
                owner = owner.GetParent()
            name = name_of(owner) if owner and not owner.IsPseudoRoot() else WORLD
            shapes[name].append(box_of(prim, frame_of(prim)))
            friction = friction_of(prim)
            if friction is not None:
                frictions[name].append(friction)
    found: dict[str, Facts] = {}
    for name, boxes in shapes.items():
        pose, mass, com, inertia = np.eye(4), 0.0, np.zeros(3), np.zeros((3, 3))
        if name in bodies:
            stated = physics.MassAPI(bodies[name])
            axes = stated.GetPrincipalAxesAttr().Get()
            diagonal = np.array(stated.GetDiagonalInertiaAttr().Get(), dtype=float)
            pose, mass = frame_of(bodies[name]), float(stated.GetMassAttr().Get())
            com = np.array(stated.GetCenterOfMassAttr().Get(), dtype=float)
            inertia = tensor(diagonal, np.array([axes.GetReal(), *axes.GetImaginary()]))
        shape = np.array(boxes).reshape(-1, 2, 3)
        friction = np.array(frictions[name])
        found[name] = Facts(pose, np.array([mass]), com, inertia, shape, friction)
    return found


def is_guide(prim: Any) -> bool:
    """Test for a site, which is seen in editors alone."""
    return str(_module("pxr.UsdGeom").Gprim(prim).GetPurposeAttr().Get()) == "guide"


def name_of(prim: Any) -> str:
    """MuJoCo's name of a prim: USD's own names have fewer characters."""
    return str(prim.GetDisplayName() or prim.GetName())


def frame_of(prim: Any) -> Array:
    """(4, 4) in the world, stretched by the prim's scale."""
    cache = _module("pxr.UsdGeom").XformCache()
    # USD multiplies rows from the left.
    return np.array(cache.GetLocalToWorldTransform(prim), dtype=float).T


def box_of(prim: Any, frame: Array) -> Array:
    def number(attribute: str) -> float:
        return float(prim.GetAttribute(attribute).Get())

    match str(prim.GetTypeName()):
        case "Mesh":
            return around(frame, np.array(prim.GetAttribute("points").Get(), dtype=float))
        case "Plane":
            return plane_box(frame)
        case "Cube":
            return around(frame, CORNERS * number("size") / 2)
        case "Sphere":
            return round_box(frame, number("radius"))
        case "Capsule":
            return round_box(frame, number("radius"), number("height") / 2)
        case _:
            return round_box(frame, number("radius"), number("height") / 2, axes=2)


def friction_of(prim: Any) -> float | None:
    """Friction of the physics material; None where a shape does not collide, or has none."""
    physics, shade = _module("pxr.UsdPhysics"), _module("pxr.UsdShade")
    if not prim.HasAPI(physics.CollisionAPI):
        return None
    if physics.CollisionAPI(prim).GetCollisionEnabledAttr().Get() is False:
        return None
    material, _ = shade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")
    value = physics.MaterialAPI(material).GetDynamicFrictionAttr().Get() if material else None
    return None if value is None else float(value)
