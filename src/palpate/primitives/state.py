"""The symbolic state, and violations of rules."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, Protocol, TypeVar, cast

import numpy as np

from palpate.common.belief import Belief, Means
from palpate.common.parameter import Parameter
from palpate.common.pose import Array, Pose, digits
from palpate.mjcf.body import Body
from palpate.primitives.rules.grip import Grip, grip
from palpate.primitives.rules.solids import solids
from palpate.robots.kinematics import forward_kinematics
from palpate.scene.load import apply_measurement, compute_rises, correct_body, moves, raise_surface
from palpate.scene.scene import Scene
from palpate.trace.recording import Activity, Context

PRECONDITION = "precondition"  # Default rule of a primitive's requirements


@dataclass(frozen=True, slots=True)
class Violation:
    """Violation of one rule by an action in a state."""

    # Its id, one of `planning.check.rules`; a third party's primitive mostly uses `precondition`.
    rule: str
    message: str  # the problem and its remedy, by which a model or a person can repair the plan

    @property
    def finding(self) -> str:
        """The message without the remedy, which is for the author of a plan."""
        return self.message.partition(";")[0]

    def __str__(self) -> str:
        return self.message


# The symbolic state: beliefs of a plan or a run about the cell between two leaves.


T = TypeVar("T")
HOME_CONFIG = "home_config"  # The joint configuration from which every pose is reached safely
# m. A top up to this height above the TCP counts as below the hand. It is the error of believed
# heights, which a contact corrects.
SINKING = 0.05
RESTORED_POSITION = 0.005  # m, position error at which an object counts as restored
SAGS = 0.01  # m and rad, largest difference of the reported pose from that of the joint angles
SAME_POSE = 1e-4  # m and rad up to which two poses are equal


class StateChange(Protocol):
    """The part of a primitive that reads and changes the symbolic state."""

    def requires(self, state: SymbolicState) -> list[Violation]:
        """Violations of its preconditions."""
        ...

    def during(self, state: SymbolicState) -> SymbolicState:
        """State while it runs."""
        ...

    def effects(self, state: SymbolicState) -> SymbolicState:
        """State after SUCCESS."""
        ...


@dataclass(frozen=True, slots=True)
class SymbolicState:
    """Immutable symbolic state; `replace` makes the next one."""

    scene: Scene  # the believed cell at rest
    at: str | None = None  # pose expression or joint configuration last reached
    pose_world_tcp: Pose | None = None  # pose of the TCP; None before the first motion of a plan
    # (7,) rad, target of the last joint motion; None at a pose, whose configuration the controller
    # chooses.
    joints: Array | None = None
    gripper: Literal["open", "closed", "unknown"] = "unknown"  # state of the fingers
    # holding, grasp: held object, and the pose expression where it was grasped
    holding: str | None = None
    grasp: str | None = None
    pose_tcp_object: Pose | None = None  # the held object's pose in the TCP frame
    lifted: bool = False  # the held object is clear of its support
    # Surface or object touched by the last guarded motion, until the arm moves on.
    contact: str | None = None
    # Poses of objects away from where the scene has them.
    moved: Mapping[str, Pose] = field(default_factory=dict[str, Pose])
    activity: Activity = "still"  # activity of a recording that starts now
    # The context in which each buffer was last written.
    buffers: Mapping[str, Context] = field(default_factory=dict[str, Context])
    logged: tuple[tuple[str, Context], ...] = ()  # every recording so far, `(buffer, context)`
    converted: frozenset[Parameter] = frozenset()  # parameters that a conversion has measured
    # Test of the arm's reach for a pose of the TCP (world); None for the scene's inverse
    # kinematics.
    reaches: Callable[[Pose], bool] | None = None
    # m along its line, for every pose bound in the run (`Symbols.lines`).
    bound: Mapping[str, float] = field(default_factory=dict[str, float])
    # Poses that touch has corrected, by body.
    beliefs: Mapping[str, Belief] = field(default_factory=dict[str, Belief])
    _next: dict[int, tuple[StateChange, SymbolicState]] = field(
        default_factory=dict[int, "tuple[StateChange, SymbolicState]"],
        init=False,
        repr=False,
        compare=False,
    )
    _unmet: dict[int, tuple[StateChange, list[Violation]]] = field(
        default_factory=dict[int, "tuple[StateChange, list[Violation]]"],
        init=False,
        repr=False,
        compare=False,
    )

    def after(self, primitive: StateChange) -> SymbolicState:
        """Return the state after SUCCESS of a primitive: its `effects`, computed once."""
        # The primitive is kept with the result, so that no other object gets its id.
        found = self._next.get(id(primitive))
        if found is None:
            found = self._next[id(primitive)] = (primitive, primitive.effects(self))
        return found[1]

    def unmet(self, primitive: StateChange) -> list[Violation]:
        """Violations of a primitive's preconditions, `requires`, computed once."""
        found = self._unmet.get(id(primitive))
        if found is None:
            found = self._unmet[id(primitive)] = (primitive, primitive.requires(self))
        return found[1]

    def standing(self, q: Array, pose_world_tcp: Pose) -> SymbolicState:
        """State with the arm at its reported joint angles `q` (7,), rad, if its pose was unknown."""
        if self.pose_world_tcp is not None:
            return self
        return replace(self, pose_world_tcp=pose_world_tcp, joints=q)

    def context(self) -> Context:
        """Context of a recording made now."""
        # A slide has no contact by name; its support is the surface below.
        support = self.contact
        if not support and self.activity == "sliding":
            below = self.surface_below(self.pose_world_tcp)
            support = below.name if below else None
        return Context(
            activity=self.activity,
            at=self.at,
            holding=self.holding,
            grasp=self.grasp,
            support=support,
        )

    def resolve(self, expression: str) -> Pose:
        """Return the TCP pose in the world of a pose expression, as `Symbols.resolve`."""
        return self.scene.symbols.resolve(expression, self.bound)

    def pose_of(self, name: str) -> Pose:
        """Believed pose of an object or surface."""
        return self.moved.get(name) or self.scene.body(name).pose_world

    def body_poses(self) -> dict[str, Pose]:
        """Believed poses of all objects, surfaces and fixtures."""
        return {**self.scene.body_poses, **self.moved}

    def place_object(self, name: str, pose: Pose) -> Mapping[str, Pose]:
        """`moved` with an object at a pose; without the object at its pose in the scene."""
        moved = {**self.moved, name: pose}
        if pose.digits == self.scene.body(name).pose_world.digits:
            del moved[name]
        return moved

    def raised(self, surface: str, top: float) -> SymbolicState:
        """State with the top of a surface at world z `top`, m, and the bodies on it raised with it."""
        # Moved objects on the surface rise as well.
        rises = compute_rises(self.scene, surface, top, self.body_poses())
        moved = {
            name: pose.translate((0.0, 0.0, rises.get(name, 0.0)))
            for name, pose in self.moved.items()
        }
        return replace(self, scene=raise_surface(self.scene, surface, top), moved=moved)

    def learn_parameter(self, parameter: Parameter, value: tuple[float, ...]) -> SymbolicState:
        """State after a parameter was measured; a height raises the bodies on its surface."""
        if moves(self.scene, parameter):
            return self.raised(parameter.object, value[0])
        return replace(self, scene=apply_measurement(self.scene, parameter, value))

    def belief_of(self, name: str) -> Belief | None:
        """Belief in the current pose of a body; None if its pose has no stated uncertainty."""
        # A belief corrected by touch comes first, else the stated covariance.
        known, covariance = self.beliefs.get(name), self.scene.body(name).covariance
        if known is None and covariance is not None:
            seen = (self.scene.as_given or self.scene).body(name)
            known = Belief.of(seen.pose_world, covariance)
        return None if known is None else known.at(self.pose_of(name))

    def touched(
        self, name: str, means: Means, along: Array, point: Array, apart: float, pushed: float = 0.0
    ) -> SymbolicState:
        """State after a touch (`Belief.update`); a body that is not held moves with its named poses."""
        before = self.belief_of(name)
        if before is None:
            return self
        after = before.update(means, along, point, apart, pushed)
        state = replace(self, beliefs={**self.beliefs, name: after})
        if name == self.holding:
            return state
        # Move the body in the scene by the step from the earlier belief to the later one.
        moved = {one: after.pose if one == name else pose for one, pose in self.moved.items()}
        step = after.placed @ before.placed.inverse()
        scene = correct_body(self.scene, name, step, after.covariance)
        return replace(state, scene=scene, moved=moved)

    @property
    def tcp(self) -> Pose:
        """Pose of the TCP, which must be known."""
        assert self.pose_world_tcp is not None
        return self.pose_world_tcp

    @property
    def is_bent(self) -> bool:
        """True after a joint motion, False at a pose."""
        if self.joints is None or self.pose_world_tcp is None:
            return False
        # The pose agrees with the joint angles up to the arm's sag.
        bent = pose_of_joints(self.scene, self.joints)
        there = self.pose_world_tcp
        return bent.distance_to(there) < SAGS and bent.angle_to(there) < SAGS

    @property
    def q(self) -> Array | None:
        """(7,) rad, joint angles; None before the first motion of a plan, or out of reach."""
        if self.is_bent or self.pose_world_tcp is None:
            return self.joints
        return solids(self.scene).configuration(self.pose_world_tcp)

    @property
    def placed(self) -> tuple[tuple[str, bytes], ...]:
        """Key of the moved objects and their poses."""
        return tuple((name, pose.digits) for name, pose in sorted(self.moved.items()))

    def others(self, name: str | None) -> tuple[tuple[str, bytes], ...]:
        """`placed` without the object `name`."""
        return tuple(entry for entry in self.placed if entry[0] != name)

    def without(self, name: str | None) -> SymbolicState:
        """State with the object `name` at its pose in the scene, and an empty hand."""
        moved = {other: pose for other, pose in self.moved.items() if other != name}
        return replace(self, moved=moved, holding=None, pose_tcp_object=None)

    @property
    def arrangement(self) -> tuple[object, ...]:
        """Key of the arrangement of arm, hand and objects."""
        pose, held = self.pose_world_tcp, self.pose_tcp_object
        return (
            None if pose is None else pose.digits,
            digits(self.joints) if self.is_bent and self.joints is not None else None,
            self.gripper,
            self.holding,
            None if held is None else held.digits,
            *self.placed,
        )

    def beside(self, start: Array, end: Array, margin: float) -> list[Body]:
        """Bodies that may be within `margin` m of a line, seen from above, in document order.

        The line goes from `start` to `end` (3,), world. Circles about the bodies bound them, and the
        held object is left out.
        """

        # Positions (b, 2) and radii (b,) of all bodies, once for each arrangement.
        def compute() -> tuple[list[Body], Array, Array]:
            still, bodies = self.without(self.holding), list(self.scene.bodies.values())
            spots = np.array([still.pose_of(body.name).position[:2] for body in bodies])
            return bodies, spots.reshape(-1, 2), np.array([body.reach for body in bodies])

        key = ("spots", *self.others(self.holding))
        bodies, spots, reaches = solids(self.scene).get_or_compute(key, compute)
        along, apart = (end - start)[:2], spots - start[:2]
        # Distance of each body's centre from the nearest point of the line.
        share = np.clip(apart @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
        apart = apart - share[:, None] * along
        near = np.hypot(apart[:, 0], apart[:, 1]) <= reaches + margin
        found = (bodies[i] for i in np.flatnonzero(near).tolist())
        return [body for body in found if body.name != self.holding]

    def object_at(self, pose_world_tcp: Pose | None) -> Body | None:
        """Object between the pads at a pose, nearest to their middle; None for an unknown pose."""
        if pose_world_tcp is None:
            return None
        pose = pose_world_tcp

        def compute() -> Body | None:
            # Test the contact of the pads only for objects within the fingers' opening.
            near = self.beside(pose.position, pose.position, self.scene.arm.hand.opening)
            names = {self.holding, *(body.name for body in near)}
            grips = [
                (body, self.grip_of(body, pose))
                for body in self.scene.objects.values()
                if body.name in names
            ]
            # Two objects in one place are an error of the plan: take the first one of the scene.
            between = [(round(abs(held.aside), 6), body) for body, held in grips if held]
            return min(between, key=lambda one: one[0], default=(0.0, None))[1]

        return solids(self.scene).get_or_compute(("between", pose.digits, *self.placed), compute)

    def grip_of(self, body: Body, pose_world_tcp: Pose) -> Grip | None:
        """Contact of the pads with an object at this pose of the TCP; None if it is not between them."""
        pose_tcp_object = pose_world_tcp.inverse() @ self.pose_of(body.name)
        return grip(solids(self.scene), body.name, pose_tcp_object)

    def surface_below(self, pose_world_tcp: Pose | None) -> Body | None:
        """Body that a guarded descent from a pose would touch first; None without one, or for an unknown pose."""
        if pose_world_tcp is None:
            return None
        x, y, z = pose_world_tcp.position.tolist()
        met, highest = None, -np.inf
        # The highest top below the TCP, with the tolerance `SINKING`.
        for body in self.beside(pose_world_tcp.position, pose_world_tcp.position, 0.0):
            if body.name == self.holding or not body.covers(x, y, self.pose_of(body.name)):
                continue
            top = self.top_of(body)
            if highest < top < z + SINKING:
                met, highest = body, top
        return met

    def top_of(self, body: Body) -> float:
        """World z, m, of the top of an object or surface."""
        return body.top_z(self.pose_of(body.name))

    def after_drag(self) -> SymbolicState:
        """State after the held object was dragged; see `Belief.after_drag`."""
        belief = None if self.holding is None else self.belief_of(self.holding)
        if self.holding is None or belief is None:
            return self
        return replace(self, beliefs={**self.beliefs, self.holding: belief.after_drag()})

    @property
    def seen(self) -> dict[str, Belief]:
        """Beliefs in the poses of all objects with a stated uncertainty, by name."""
        found = {name: self.belief_of(name) for name in self.scene.objects}
        return {name: belief for name, belief in found.items() if belief is not None}

    def elsewhere(self) -> dict[str, Pose]:
        """Poses of the objects that are not at their poses in the scene as given."""
        # Poses corrected by touch, and objects that the plan displaced.
        felt = {name: self.pose_of(name) for name, one in self.beliefs.items() if one.is_moved}
        return felt | self.displaced_objects()

    def displaced_objects(self) -> dict[str, Pose]:
        """Poses of the objects that the plan moved by more than `RESTORED_POSITION`, by name."""
        return {
            name: pose
            for name, pose in self.moved.items()
            if pose.distance_to(self.scene.body(name).pose_world) > RESTORED_POSITION
        }

    def add_recording(self, buffer: str) -> SymbolicState:
        """State after a sensing leaf filled `buffer` in the current context."""
        context = self.context()
        return replace(
            self,
            buffers={**self.buffers, buffer: context},
            logged=(*self.logged, (buffer, context)),
        )


def pose_of_joints(scene: Scene, joints: Array) -> Pose:
    """Pose of the TCP (world) at joint angles (7,), rad."""
    return scene.pose_world_base @ forward_kinematics(scene.arm, tuple(joints.tolist()))


def during(moving: Iterable[StateChange], state: SymbolicState) -> SymbolicState:
    """State while `moving` run: the context of a sensing leaf in the same Parallel."""
    for primitive in moving:
        state = primitive.during(state)
    return state


def parallel(
    before: SymbolicState,
    meanwhile: SymbolicState,
    moving: Sequence[T],
    branches: Iterable[Sequence[T]],
    fold: Callable[[T, SymbolicState], SymbolicState],
) -> SymbolicState:
    """State after a Parallel of leaves that move and branches that sense `meanwhile`.

    `fold` gives the state after one leaf. The order in which branches end makes no difference: each
    adds its changes.
    """
    # Fold the leaves that move, then add the changes of each sensing branch.
    now = before
    for leaf in moving:
        now = fold(leaf, now)
    for branch in branches:
        state = meanwhile
        for leaf in branch:
            state = fold(leaf, state)
        now = merge_states(now, meanwhile, state)
    return now


def merge_states(now: SymbolicState, base: SymbolicState, after: SymbolicState) -> SymbolicState:
    """`now` with the changes from `base` to `after`: leaves in a Parallel overlap in time."""
    if after is base:
        return now
    # Compare by identity: unchanged fields are the same objects.
    changes: dict[str, Any] = {}
    for name in (one.name for one in fields(SymbolicState) if one.init):
        old, new = getattr(base, name), getattr(after, name)
        if new is not old:
            changes[name] = _join_field(getattr(now, name), old, new)
    return replace(now, **changes)


def _join_field(now: Any, old: Any, new: Any) -> Any:
    """Field `now` with the changes from `old` to `new`."""
    # Keep entries that other branches added to buffers, logs, conversions and moved objects.
    if isinstance(new, Mapping):
        entries = cast(Mapping[str, object], new)
        added = {key: value for key, value in entries.items() if old.get(key) is not value}
        kept = {key: value for key, value in now.items() if key in entries or key not in old}
        return {**kept, **added}
    if isinstance(new, frozenset):
        return now | new
    if isinstance(new, tuple):
        return (*now, *new[len(old) :])
    return new
