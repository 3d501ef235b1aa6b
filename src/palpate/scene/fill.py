"""From values of quantities to changes of MJCF attributes.

One set of rules serves the model that is simulated (changes made to a parsed copy) and the twin
(the same changes made to the user's text), so both mean the same:

- mass: `<inertial mass>` where there is one, else `mass` of the geoms that lack it, shared by
  volume; in the new `<inertial>` alone when a centre of mass is written too.
- friction: the first number of `friction` on the geoms that lack it, with `priority="1"`, without
  which MuJoCo would take the larger of the object's and its support's coefficient.
- height: the number that is unknown. When half height and place both are, a geom stands on its
  body's origin, and a body on the ground.
- com: `<inertial>`, made when absent, with the inertia of the geoms taken about the new centre.
- position: x and y of the body's frame. An unknown z follows: the object stands on the surface
  below it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from palpate.errors import InputError
from palpate.geometry.inertia import components, inertia_attributes, rotation, tensor_of
from palpate.geometry.pose import Array
from palpate.mjcf.compile import MUJOCO_FRICTION
from palpate.mjcf.document import UNKNOWN, Element, has_unknown, label, tokens
from palpate.mjcf.edits import Edit, Insert, number
from palpate.mjcf.roles import Inventory, ObjectEntry, SurfaceEntry, half_height_index
from palpate.mjcf.shapes import Shapes
from palpate.parameter import Parameter

PLACEHOLDER = 0.01
"""m: stands for an unknown half height while the scene's shapes are compiled."""

Values = Mapping[Parameter, tuple[float, ...]]


def placeholders(found: Inventory) -> list[Edit]:
    """Changes that let a scene compile before anything is known: positions 0, half heights
    `PLACEHOLDER`."""
    edits: list[Edit] = []
    for thing in found.objects.values():
        edits += _for_unknown(thing.element, "pos", "0")
        for geom in thing.geoms:
            edits += [*_for_unknown(geom, "mass", "1"), *_for_unknown(geom, "density", "1000")]
            edits += _for_unknown(geom, "friction", "1")
        if thing.inertial is not None:
            edits += [
                *_for_unknown(thing.inertial, "pos", "0"),
                *_for_unknown(thing.inertial, "mass", "1"),
            ]
            edits += _for_unknown(thing.inertial, "diaginertia", "0.001")
            edits += [
                Edit(thing.inertial, "fullinertia", dict(enumerate(["1", "1", "1", "0", "0", "0"])))
                for _ in _for_unknown(thing.inertial, "fullinertia", "1")
            ]
    for surface in found.surfaces.values():
        edits += _for_unknown(surface.element, "pos", "0")
        for geom in surface.geoms:
            edits += [
                *_for_unknown(geom, "pos", "0"),
                *_for_unknown(geom, "size", str(PLACEHOLDER)),
            ]
    return list({(id(e.element), e.attribute): e for e in edits}.values())


def _for_unknown(element: Element, attribute: str, filler: str) -> list[Edit]:
    unknown = [i for i, part in enumerate(tokens(element.get(attribute))) if part == UNKNOWN]
    return [Edit(element, attribute, dict.fromkeys(unknown, filler))] if unknown else []


@dataclass(frozen=True, slots=True)
class Filler:
    """Writes values into a scene.

    Attributes:
        found: what the scene holds. shapes: its geometry, compiled with `placeholders`.
        std: standard deviations, which decide how many digits are written.
        given_z: world z of objects whose `pos` leaves it open, where poses came with the scene, m.
    """

    found: Inventory
    shapes: Shapes
    std: Mapping[Parameter, float] = field(default_factory=dict[Parameter, float])
    given_z: Mapping[str, float] = field(default_factory=dict[str, float])

    def edits(self, values: Values, known: Values) -> list[Edit | Insert]:
        """The changes that state `values`; `known` holds what they rest on but leave alone (masses,
        heights).

        Raises:
            InputError: a value for what the scene does not have, or for what has no place in MJCF.
        """
        made: list[Edit | Insert] = []
        for name in dict.fromkeys(parameter.object for parameter in values):
            mine = {
                parameter.quantity: value
                for parameter, value in values.items()
                if parameter.object == name
            }
            if name in self.found.objects:
                made += self._object(self.found.objects[name], mine, known)
            elif name in self.found.surfaces and "height" in mine:
                made += self._height(self.found.surfaces[name], mine["height"][0])
            else:
                raise InputError(
                    f"no object or surface '{name}' of the scene has a {' or '.join(mine)}"
                )
        return [*made, *self._standing({**known, **values})]

    def _object(
        self, thing: ObjectEntry, mine: Mapping[str, tuple[float, ...]], known: Values
    ) -> Iterator[Edit | Insert]:
        if "com" in mine or "inertia" in mine:
            yield from self._inertial(thing, mine, known)
        elif "mass" in mine:
            yield from self._mass(thing, mine["mass"][0])
        if "friction" in mine:
            yield from self._friction(thing, mine["friction"][0])
        if "position" in mine:
            yield self._position(thing, mine["position"])

    def _text(self, name: str, quantity: str, value: float) -> str:
        return number(value, self.std.get(Parameter(name, quantity)))

    def _mass(self, thing: ObjectEntry, mass: float) -> Iterator[Edit]:
        if mass <= 0:
            raise InputError(
                f"a mass of {mass:.6g} kg for '{thing.name}' cannot be written; it must be above zero"
            )
        if thing.inertial is not None:
            yield Edit(thing.inertial, "mass", {0: self._text(thing.name, "mass", mass)})
            return
        geoms = thing.unweighed or thing.geoms
        volumes = np.array([max(self.shapes.volume(geom), 1e-12) for geom in geoms])
        own = max(mass - self._stated_mass(thing, geoms), 1e-6)
        for geom, volume in zip(geoms, volumes, strict=True):
            share = own * float(volume / volumes.sum())
            if UNKNOWN in tokens(geom.get("density")):
                yield Edit(geom, "density", {0: number(share / float(volume))})
            else:
                text = self._text(thing.name, "mass", share) if len(geoms) == 1 else number(share)
                yield Edit(geom, "mass", {0: text})

    def _stated_mass(self, thing: ObjectEntry, geoms: Sequence[Element]) -> float:
        """Mass of the object's other geoms, kg."""
        total = 0.0
        for geom in thing.geoms:
            if geom not in geoms:
                mass = self.found.defaults.attribute(geom, "mass")
                density = self.found.defaults.attribute(geom, "density") or "1000"
                total += float(mass) if mass else float(density) * self.shapes.volume(geom)
        return total

    def _friction(self, thing: ObjectEntry, friction: float) -> Iterator[Edit]:
        text = self._text(thing.name, "friction", friction)
        for geom in thing.missing_friction or thing.colliding:
            base = self.found.defaults.attribute(geom, "friction") or " ".join(MUJOCO_FRICTION)
            others = {
                i: MUJOCO_FRICTION[i] for i, part in enumerate(tokens(base)[:3]) if part == UNKNOWN
            }
            yield Edit(geom, "friction", {**others, 0: text}, base)
            if not self.found.defaults.attribute(geom, "priority"):
                yield Edit(geom, "priority", {0: "1"})

    def _position(self, thing: ObjectEntry, position: Sequence[float]) -> Edit:
        _refuse_frame(thing.element)
        texts = {i: self._text(thing.name, "position", v) for i, v in enumerate(position[:2])}
        return Edit(thing.element, "pos", _unknown_only(thing.element, "pos", texts), "0 0 0")

    def _standing(self, values: Values) -> Iterator[Edit]:
        for thing in self.found.objects.values():
            if not has_unknown(thing.element, "pos", 2):
                continue
            _refuse_frame(thing.element)
            support = self.support_z(thing, values)
            if support is not None or thing.name in self.given_z:
                bottom = float(self.shapes.cloud(thing.colliding)[:, 2].min())
                z = self.given_z.get(thing.name, (support or 0.0) - bottom)
                yield Edit(thing.element, "pos", {2: number(z)})

    def support_z(self, thing: ObjectEntry, values: Values) -> float | None:
        """World z of the highest surface below the middle of an object, the ground without one, m.

        None while the height of a surface below it is unknown.
        """
        cloud = self.shapes.cloud(thing.colliding)
        middle = (cloud.max(axis=0) + cloud.min(axis=0)) / 2
        below = [s for s in self.found.surfaces.values() if self.covers(s, middle)]
        heights = {s.name: values.get(Parameter(s.name, "height")) for s in below}
        if any(s.missing and heights[s.name] is None for s in below):
            return None
        return max(((heights[s.name] or (self.top_z(s),))[0] for s in below), default=0.0)

    def covers(self, surface: SurfaceEntry, point: Array) -> bool:
        """Whether a point's x-y is within the box around the surface's top."""
        cloud = self.shapes.points(self.carrier(surface))
        return bool(
            np.all(point[:2] >= cloud.min(axis=0)[:2])
            and np.all(point[:2] <= cloud.max(axis=0)[:2])
        )

    def carrier(self, surface: SurfaceEntry) -> Element:
        """The geom whose top carries: the one with the largest level face."""
        return carrier(self.shapes, surface)

    def top_z(self, surface: SurfaceEntry) -> float:
        """World z of its top as compiled, m."""
        return float(self.shapes.points(self.carrier(surface))[:, 2].max())

    def _height(self, surface: SurfaceEntry, height: float) -> Iterator[Edit]:
        geom = self.carrier(surface)
        unknown = surface.unknown or frozenset(
            {"body" if surface.element.tag == "body" else "geom"}
        )
        rise = height - self.top_z(surface)
        if "size" in unknown:
            rise, half = self._half_height(unknown, rise)
            if half <= 0:
                raise InputError(
                    f"a height of {height:.4g} m leaves '{surface.name}' no thickness ({label(geom)})"
                )
            index = half_height_index(geom, self.found.defaults)
            assert index is not None
            yield Edit(geom, "size", {index: self._text(surface.name, "height", half)})
        if "geom" in unknown:
            yield self._raised(geom, surface, rise)
        if "body" in unknown:
            yield self._raised(surface.element, surface, 0.0 if "geom" in unknown else rise)

    @staticmethod
    def _half_height(unknown: frozenset[str], rise: float) -> tuple[float, float]:
        """What the position rises and the half height becomes, from how far the top must rise."""
        if unknown == frozenset({"size"}):
            return 0.0, PLACEHOLDER + rise
        half = (rise + PLACEHOLDER) / 2
        return half, half

    def _raised(self, element: Element, surface: SurfaceEntry, rise: float) -> Edit:
        base = element.get("pos") or "0 0 0"
        part = tokens(base)[2]
        z = rise + (0.0 if part == UNKNOWN else float(part))
        return Edit(element, "pos", {2: self._text(surface.name, "height", z)}, "0 0 0")

    def _inertial(
        self, thing: ObjectEntry, mine: Mapping[str, tuple[float, ...]], known: Values
    ) -> Iterator[Edit | Insert]:
        if any(e.tag == "body" for e in thing.element.iterdescendants()):
            raise InputError(
                f"'{thing.name}' is made of several bodies; MJCF has no one place for its centre of mass"
            )
        given = mine.get("mass") or known.get(Parameter(thing.name, "mass"))
        if given is None and "mass" in thing.missing:
            raise InputError(
                f"the centre of mass of '{thing.name}' cannot be written without its mass"
            )
        mass = given[0] if given else self.mass(thing)
        com = np.array(
            mine.get("com") or known.get(Parameter(thing.name, "com")) or self.com(thing)
        )
        tensor = tensor_of(mine["inertia"]) if "inertia" in mine else self.inertia(thing, mass, com)
        pos = {i: self._text(thing.name, "com", float(v)) for i, v in enumerate(com)}
        if thing.inertial is None:
            stated = {"pos": " ".join(pos.values()), "mass": self._text(thing.name, "mass", mass)}
            yield Insert(thing.element, "inertial", {**stated, **inertia_attributes(tensor)})
            yield from (
                Edit(g, a, {0: number(mass / len(thing.unweighed))})
                for g in thing.unweighed
                for a in ("mass", "density")
                if UNKNOWN in tokens(g.get(a))
            )
            return
        if "com" in mine:
            yield Edit(thing.inertial, "pos", _unknown_only(thing.inertial, "pos", pos), "? ? ?")
        if "mass" in mine:
            yield Edit(thing.inertial, "mass", {0: self._text(thing.name, "mass", mass)})
        if "inertia" in thing.missing or "inertia" in mine:
            yield from _stated_inertia(thing.inertial, tensor)

    def completed(self, priors: Values, values: Values) -> dict[Parameter, tuple[float, ...]]:
        """`values`, and `priors` for the rest; an assumed inertia is the one that goes with the
        mass and centre."""
        merged = {**priors, **values}
        for parameter in [g for g in merged if g.quantity == "inertia" and g not in values]:
            thing = self.found.objects[parameter.object]
            mass = merged.get(Parameter(parameter.object, "mass"), (self.mass(thing),))[0]
            com = merged.get(Parameter(parameter.object, "com"), self.com(thing))
            merged[parameter] = self.inertia_values(thing, mass, np.array(com))
        return merged

    def mass(self, thing: ObjectEntry) -> float:
        """The object's mass as the MJCF states it (or a placeholder), kg."""
        if thing.inertial is not None and thing.inertial.get("mass") not in (None, UNKNOWN):
            return float(thing.inertial.get("mass") or 0)
        return float(self.shapes.model.body_subtreemass[self.shapes.model.body(thing.name).id])

    def com(self, thing: ObjectEntry) -> tuple[float, ...]:
        """Centre of mass in the body frame, as MuJoCo has it, m."""
        return tuple(float(v) for v in self.shapes.model.body(thing.name).ipos)

    def inertia(self, thing: ObjectEntry, mass: float, com: Array) -> Array:
        """(3, 3) inertia about `com` in body axes, kg m²: the geoms' own, or their box's, scaled to
        `mass`."""
        if thing.inertial is None:
            tensor, centre = self._compiled_inertia(thing, mass)
        else:
            tensor, centre = self._box_inertia(thing, mass)
        offset = com - centre
        return tensor + mass * (offset @ offset * np.eye(3) - np.outer(offset, offset))

    def inertia_values(self, thing: ObjectEntry, mass: float, com: Array) -> tuple[float, ...]:
        """As `inertia`: xx yy zz xy xz yz."""
        return tuple(components(self.inertia(thing, mass, com)))

    def _compiled_inertia(self, thing: ObjectEntry, mass: float) -> tuple[Array, Array]:
        body = self.shapes.model.body(thing.name)
        axes = rotation(np.asarray(body.iquat))
        scale = mass / float(body.mass[0])
        return axes @ np.diag(np.asarray(body.inertia)) @ axes.T * scale, np.asarray(body.ipos)

    def _box_inertia(self, thing: ObjectEntry, mass: float) -> tuple[Array, Array]:
        to_body = self.shapes.body_pose(thing.name).inverse()
        cloud = np.array([to_body.apply(point) for point in self.shapes.cloud(thing.geoms)])
        squares = (cloud.max(axis=0) - cloud.min(axis=0)) ** 2
        return np.diag(mass / 12 * (squares.sum() - squares)), (
            cloud.max(axis=0) + cloud.min(axis=0)
        ) / 2


def carrier(shapes: Shapes, surface: SurfaceEntry) -> Element:
    """The geom of a surface with the largest footprint (the higher of equals)."""

    def footprint(geom: Element) -> tuple[float, float]:
        cloud = shapes.points(geom)
        x, y, _ = cloud.max(axis=0) - cloud.min(axis=0)
        return round(float(x * y), 6), float(cloud[:, 2].max())

    return max(surface.geoms, key=footprint)


def _unknown_only(element: Element, attribute: str, texts: Mapping[int, str]) -> dict[int, str]:
    """Those of `texts` whose number is `?`; all of them when none is (a value measured again)."""
    parts = tokens(element.get(attribute))
    unknown = {i: text for i, text in texts.items() if i < len(parts) and parts[i] == UNKNOWN}
    return unknown or dict(texts)


def _refuse_frame(element: Element) -> None:
    parent = element.getparent()
    if parent is not None and parent.tag == "frame" and set(parent.attrib) - {"childclass", "name"}:
        raise InputError(
            f"{label(element)} is inside a <frame> that moves it; write its pos in the world to have it "
            "measured"
        )


def _stated_inertia(inertial: Element, tensor: Array) -> Iterator[Edit]:
    texts = {i: number(part) for i, part in enumerate(components(tensor))}
    if inertial.get("fullinertia") is not None:
        yield Edit(inertial, "fullinertia", _unknown_only(inertial, "fullinertia", texts))
    else:
        diagonal = {i: text for i, text in texts.items() if i < 3}
        yield Edit(
            inertial, "diaginertia", _unknown_only(inertial, "diaginertia", diagonal), "? ? ?"
        )
