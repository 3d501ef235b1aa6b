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
    WORLD,
    Facts,
    Shape,
    around,
    cylinder_box,
    plane_box,
    round_box,
)

_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


def require_usd() -> None:
    """See whether the converter is there.

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


def write_usd(spec: mujoco.MjSpec, mjcf: Path, folder: Path) -> Path:
    """Convert a model, which is written as `mjcf` beside its files for that, into one `.usdc`."""
    mjcf.write_text(spec.to_xml(), encoding="utf-8")
    diagnostics = _module("usdex.core")
    diagnostics.activateDiagnosticsDelegate()
    diagnostics.setDiagnosticsLevel(diagnostics.DiagnosticsLevel.eError)
    converter = _module("mujoco_usd_converter").Converter(layer_structure=False)
    written = converter.convert(str(mjcf), str(folder.resolve()))
    return folder / Path(str(written.path)).name


def read_usd(path: Path) -> dict[str, Facts]:
    """Facts about a stage's rigid bodies and colliders."""
    stage = _module("pxr.Usd").Stage.Open(str(path))
    shapes: dict[str, list[Shape]] = {WORLD: []}
    bodies: dict[str, Any] = {}
    for prim in stage.Traverse():
        if prim.HasAPI(_module("pxr.UsdPhysics").RigidBodyAPI):
            bodies[_name(prim)] = prim
            shapes[_name(prim)] = []
        elif prim.IsA(_module("pxr.UsdGeom").Gprim) and not _is_guide(prim):
            shapes[_owner(prim)].append(_shape(prim))
    found = {WORLD: Facts(np.eye(4), 0.0, np.zeros(3), np.zeros((3, 3)), tuple(shapes[WORLD]))}
    for name, prim in bodies.items():
        found[name] = _facts(prim, tuple(shapes[name]))
    return found


def _name(prim: Any) -> str:
    """MuJoCo's name of a prim: USD's own names have fewer characters."""
    return str(prim.GetDisplayName() or prim.GetName())


def _is_guide(prim: Any) -> bool:
    """True if it is a site: there to be seen in editors alone."""
    return str(_module("pxr.UsdGeom").Gprim(prim).GetPurposeAttr().Get()) == "guide"


def _owner(prim: Any) -> str:
    """The body that a shape belongs to."""
    above = prim.GetParent()
    while above and not above.IsPseudoRoot():
        if above.HasAPI(_module("pxr.UsdPhysics").RigidBodyAPI):
            return _name(above)
        above = above.GetParent()
    return WORLD


def _facts(prim: Any, shapes: tuple[Shape, ...]) -> Facts:
    stated = _module("pxr.UsdPhysics").MassAPI(prim)
    diagonal = np.array(stated.GetDiagonalInertiaAttr().Get(), dtype=float)
    axes = stated.GetPrincipalAxesAttr().Get()
    quaternion = np.array([axes.GetReal(), *axes.GetImaginary()], dtype=float)
    turned = np.empty(9)
    mujoco.mju_quat2Mat(turned, quaternion)
    rotation = turned.reshape(3, 3)
    return Facts(
        _frame(prim),
        float(stated.GetMassAttr().Get()),
        np.array(stated.GetCenterOfMassAttr().Get(), dtype=float),
        rotation @ np.diag(diagonal) @ rotation.T,
        shapes,
    )


def _frame(prim: Any) -> Array:
    """(4, 4) in the world, stretched where the prim is; USD's own matrices are for rows."""
    cache = _module("pxr.UsdGeom").XformCache()
    return np.array(cache.GetLocalToWorldTransform(prim), dtype=float).T


def _shape(prim: Any) -> Shape:
    return Shape(_box(prim, _frame(prim)), _friction(prim))


def _box(prim: Any, frame: Array) -> Array:
    kind = str(prim.GetTypeName())
    if kind == "Mesh":
        return around(frame, np.array(prim.GetAttribute("points").Get(), dtype=float))
    if kind == "Plane":
        return plane_box(frame)
    if kind == "Cube":
        return around(frame, _CORNERS * float(prim.GetAttribute("size").Get()) / 2)
    radius = float(prim.GetAttribute("radius").Get())
    if kind == "Sphere":
        return round_box(frame, radius)
    half = float(prim.GetAttribute("height").Get()) / 2
    return (
        round_box(frame, radius, half) if kind == "Capsule" else cylinder_box(frame, radius, half)
    )


def _friction(prim: Any) -> float | None:
    """Of what a shape is bound to; None where it does not collide."""
    physics, shade = _module("pxr.UsdPhysics"), _module("pxr.UsdShade")
    if not prim.HasAPI(physics.CollisionAPI):
        return None
    if physics.CollisionAPI(prim).GetCollisionEnabledAttr().Get() is False:
        return None
    material, _ = shade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")
    value = physics.MaterialAPI(material).GetDynamicFrictionAttr().Get() if material else None
    return None if value is None else float(value)


def _module(name: str) -> Any:
    """A module of the extra, loaded when it is used; USD has no types."""
    return importlib.import_module(name)


def left_behind(spec: mujoco.MjSpec) -> Iterator[str]:
    """Elements that the converter cannot represent, by kind."""
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
