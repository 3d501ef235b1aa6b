"""The walk of the check over a tree: grammar first, then the symbolic state folded leaf by leaf."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from difflib import get_close_matches

from pydantic import ValidationError

from palpate.errors import InputError
from palpate.geometry.pose import Pose
from palpate.parameter import Parameter
from palpate.planning.nodes import during, leaves, primitive_of
from palpate.planning.plan import Node
from palpate.quantities.catalogue import catalogue
from palpate.quantities.quantity import Piece
from palpate.scene.scene import Scene
from palpate.trace.recording import Context
from palpate.vocabulary.admissible.clearance import TOUCH, motion_to, straddled
from palpate.vocabulary.base import ConversionPrimitive, Primitive
from palpate.vocabulary.registry import vocabulary
from palpate.vocabulary.state import SymbolicState, merged

Reach = Callable[[Pose], bool]

MIN_SLIDE = 0.03
"""m: a shorter slide is not much more than the grip's and the arm's compliance."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Something wrong with a plan: where (`tree.children[3]`), which rule, and what to do about
    it."""

    path: str
    rule: str
    message: str


@dataclass(slots=True)
class _Recorded:
    path: str
    buffer: str
    context: Context
    used: bool = False


def static_findings(tree: Node, buffers: bool) -> Iterator[Finding]:
    """Grammar: types, arguments, composites, owners; and, with `buffers`, the order of writing and
    reading."""
    composites = vocabulary().composites
    written: set[str] = set()
    for path, node in tree.walk():
        if node.type in composites:
            yield from _composite(path, node)
            continue
        primitive, problems = made(path, node)
        yield from problems
        if buffers and primitive is not None:
            if primitive.reads and primitive.reads not in written:
                yield _unwritten(path, primitive)
            written |= {primitive.writes} if primitive.writes else set()


def made(path: str, node: Node) -> tuple[Primitive | None, list[Finding]]:
    """The primitive a leaf stands for, or what keeps it from being one."""
    known = vocabulary()
    if node.type not in known.primitives:
        names = [*known.primitives, *known.composites]
        close = get_close_matches(node.type.lower(), [n.lower() for n in names], 1, 0.6)
        meant = next((n for n in names if n.lower() in close), None)
        hint = f"did you mean {meant}?" if meant else f"valid: {', '.join(names)}"
        return None, [Finding(path, "unknown-primitive", f"there is no '{node.type[:80]}'; {hint}")]
    problems = (
        [
            Finding(
                path,
                "leaf-children",
                f"{node.type} takes no children; put them beside it, in a Sequence",
            )
        ]
        if node.children
        else []
    )
    try:
        return primitive_of(node), problems
    except ValidationError as error:
        return None, [*problems, *_bad_arguments(path, node, error)]
    except TypeError:
        return None, [
            *problems,
            Finding(path, "bad-argument", f"the arguments of {node.type} have no proper names"),
        ]


def _bad_arguments(path: str, node: Node, error: ValidationError) -> Iterator[Finding]:
    fields = vocabulary().primitives[node.type].model_fields
    takes = "takes " + (
        ", ".join(f"'{name}' ({f.description})" for name, f in fields.items()) or "no arguments"
    )
    for problem in error.errors(include_url=False)[:3]:
        where = ".".join(str(part) for part in problem["loc"])[:60]
        yield Finding(path, "bad-argument", f"{node.type}: '{where}': {problem['msg']}; it {takes}")


def _composite(path: str, node: Node) -> Iterator[Finding]:
    if not node.children:
        yield Finding(
            path,
            "empty-composite",
            f"an empty {node.type} does nothing; give it children or remove it",
        )
    if node.args:
        yield Finding(
            path,
            "bad-argument",
            f"{node.type} takes only 'children' and 'name', not "
            f"{', '.join(repr(k[:40]) for k, _ in node.args)}",
        )
    if node.type == "Parallel":
        for resource, owners in _owners(path, node).items():
            if len(owners) > 1:
                named = ", ".join(owners[:4]) + (" …" if len(owners) > 4 else "")
                yield Finding(
                    path,
                    "one-owner",
                    f"{len(owners)} leaves would move the {resource} at once ({named}); "
                    "there is one: put all but one after another, in a Sequence",
                )


def _owners(path: str, node: Node) -> dict[str, list[str]]:
    owners: dict[str, list[str]] = {}
    for where, leaf in leaves(node, path):
        cls = vocabulary().primitives.get(leaf.type)
        for resource in sorted(cls.claims) if cls else ():
            owners.setdefault(resource, []).append(where.removeprefix(f"{path}."))
    return owners


def _unwritten(path: str, primitive: Primitive) -> Finding:
    writers = [n for n, cls in vocabulary().primitives.items() if cls.writes == primitive.reads]
    return Finding(
        path,
        "buffer-unwritten",
        f"{type(primitive).__name__} reads `{primitive.reads}`, which nothing "
        f"before it writes; put {' or '.join(writers) or 'its sensing'} before it",
    )


class Walk:
    """Folds a tree over the symbolic state and notes what does not hold."""

    def __init__(self, scene: Scene, reachable: Reach | None) -> None:
        self.scene = scene
        self.state = SymbolicState(scene)
        self.findings: list[Finding] = []
        self.grasped: list[tuple[str, str]] = []
        self.conversions: list[tuple[str, Parameter, bool]] = []
        """Path, what it yields, and whether it is the first to."""
        self._recorded: list[_Recorded] = []
        self._helped: dict[str, set[Parameter]] = {}
        self._reachable = reachable or self._arm_reaches
        self._lost = False

    def fold(self, node: Node, path: str = "tree") -> None:
        """Walk `node` and all below it."""
        if node.type not in vocabulary().composites:
            if (primitive := made(path, node)[0]) is not None:
                self._leaf(path, primitive)
        elif node.type == "Parallel" and all(len(o) == 1 for o in _owners(path, node).values()):
            self._parallel(node, path)
        else:
            for i, child in enumerate(node.children):
                self.fold(child, f"{path}.children[{i}]")

    def unused_recordings(self, parameters: Iterable[Parameter]) -> Iterator[str]:
        """Paths of sensing leaves that neither a conversion nor a derived parameter needs."""
        wanted = list(parameters)
        seen: set[tuple[Parameter, Piece]] = set()
        for recorded in self._recorded:
            new: set[tuple[Parameter, Piece]] = set()
            for parameter in wanted:
                piece = catalogue().piece(parameter, recorded.buffer, recorded.context)
                if piece is not None:
                    new.add((parameter, piece))
            if not recorded.used and new <= seen:
                yield recorded.path
            seen |= new

    def tools(self, parameters: Iterable[Parameter]) -> set[str]:
        """Objects that were held while a parameter of something else was measured."""
        return {
            name for name, helped in self._helped.items() if any(p in helped for p in parameters)
        }

    def _parallel(self, node: Node, path: str) -> None:
        """One branch may move; the others sense what is so meanwhile."""
        before = self.state
        made_leaves = [
            (where, p)
            for where, leaf in leaves(node, path)
            if (p := made(where, leaf)[0]) is not None
        ]
        moving = [(where, p) for where, p in made_leaves if p.claims]
        meanwhile = during([p for _, p in moving], before)
        branches: list[SymbolicState] = []
        for i, child in enumerate(node.children):
            self.state = meanwhile
            for where, leaf in leaves(child, f"{path}.children[{i}]"):
                if (primitive := made(where, leaf)[0]) is not None and not primitive.claims:
                    self._leaf(where, primitive)
            branches.append(self.state)
        self.state = before
        for where, primitive in moving:
            self._leaf(where, primitive)
        self._slides(path, before, meanwhile)
        self.state = merged(self.state, branches, before)

    def _slides(self, path: str, before: SymbolicState, meanwhile: SymbolicState) -> None:
        if (
            meanwhile.activity != "sliding"
            or before.pose_world_tcp is None
            or self.state.pose_world_tcp is None
        ):
            return
        travel = before.pose_world_tcp.distance_to(self.state.pose_world_tcp)
        if travel < MIN_SLIDE:
            factor = math.ceil(2 * MIN_SLIDE / max(travel, 1e-3))
            self.findings.append(
                Finding(
                    path,
                    "short-slide",
                    (
                        f"'{before.holding}' is slid by only {1e3 * travel:.0f} mm; slide it "
                        f"{1e3 * MIN_SLIDE:.0f} mm or more, with a factor of {factor} on the offset"
                    ),
                )
            )

    def _leaf(self, path: str, primitive: Primitive) -> None:
        before = self.state
        self._require(path, primitive, before)
        try:
            after = primitive.effects(before)
        except InputError:
            self._lost = True
            self.state = replace(before, pose_world_tcp=None, at=None)
            return
        if primitive.claims:
            self._lost = self._lost and after.pose_world_tcp is None and "arm" in primitive.claims
            self._moves(path, primitive, before, after)
        self._note(path, primitive, before, after)
        self.state = after

    def _require(self, path: str, primitive: Primitive, state: SymbolicState) -> None:
        if primitive.reads and primitive.reads not in state.buffers:
            self.findings.append(_unwritten(path, primitive))
            return
        expression = getattr(primitive, "pose", None)
        if isinstance(expression, str) and (problem := self._pose_problem(path, expression)):
            self.findings.append(problem)
            return
        for message in primitive.requires(state):
            rule = self._rule(primitive, state)
            if not (self._lost and rule in ("precondition", "gripper-state")):
                self.findings.append(Finding(path, rule, message))

    def _pose_problem(self, path: str, expression: str) -> Finding | None:
        try:
            pose = self.scene.symbols.resolve(expression)
        except InputError as error:
            return Finding(path, "unknown-symbol", str(error))
        if self._reachable(pose):
            return None
        x, y, z = pose.position
        return Finding(
            path,
            "unreachable",
            f"'{expression}' at ({x:.3f}, {y:.3f}, {z:.3f}) m is out of the arm's "
            "reach; choose a pose nearer to the base, or leave out what needs it and "
            "explain",
        )

    def _rule(self, primitive: Primitive, state: SymbolicState) -> str:
        if primitive.group == "gripper":
            body = state.object_at(state.pose_world_tcp) if state.pose_world_tcp else None
            too_wide = (
                body is not None
                and body.name in self.scene.symbols.ungraspable
                and state.gripper == "open"
            )
            return "too-wide" if too_wide else "gripper-state"
        joints = getattr(primitive, "joints", None)
        if isinstance(joints, str):
            try:
                self.scene.symbols.joints(joints)
            except InputError:
                return "unknown-symbol"
        return (
            "unreachable" if hasattr(primitive, "joints") and not state.holding else "precondition"
        )

    def _moves(
        self, path: str, primitive: Primitive, before: SymbolicState, after: SymbolicState
    ) -> None:
        if after.holding and after.holding != before.holding:
            self._grasps(path, after.holding)
        if "arm" not in primitive.claims or self._lost or after.at == before.at:
            return
        between = straddled(before, before.pose_world_tcp) if not before.holding else None
        end = after.pose_world_tcp
        motion = motion_to(before, end) if end is not None else None
        if end is None:
            if between:
                self._sideways(path, between, "leave")
            return
        if motion is None:
            return
        entered = straddled(before, end) if not before.holding else None
        if entered and entered != between and not motion.vertical:
            self._sideways(path, entered, "approach")
        elif between and entered != between and motion.flat:
            self._sideways(path, between, "leave")
        for name in motion.hits(ignoring=[n for n in (between, entered) if n], margin=-TOUCH):
            self.findings.append(
                Finding(
                    path,
                    "blocked",
                    f"on the way to '{after.at}' the hand would run into "
                    f"'{name}'; go around it, or carry it away first and back "
                    "later",
                )
            )

    def _sideways(self, path: str, name: str, verb: str) -> None:
        what = "enter from" if verb == "approach" else "leave to"
        self.findings.append(
            Finding(
                path,
                "sideways",
                f"the fingers would {what} the side of '{name}' and push it "
                f"over; MovePose to '{name}_pose + z_offset' first",
            )
        )

    def _grasps(self, path: str, name: str) -> None:
        self.grasped.append((path, name))
        mass = self.scene.body(name).known.get("mass", (0.0,))[0]
        payload = self.scene.arm.limits.payload
        if mass > payload:
            self.findings.append(
                Finding(
                    path,
                    "payload",
                    f"'{name}' weighs {mass:g} kg, more than the payload of "
                    f"{payload:g} kg; it cannot be lifted",
                )
            )

    def _note(
        self, path: str, primitive: Primitive, before: SymbolicState, after: SymbolicState
    ) -> None:
        if primitive.writes and len(after.logged) > len(before.logged):
            self._recorded.append(_Recorded(path, *after.logged[-1]))
        if primitive.measures is None:
            return
        for recorded in reversed(self._recorded):
            if recorded.buffer == primitive.reads:
                recorded.used = True
                break
        subject = primitive.subject(before) if isinstance(primitive, ConversionPrimitive) else None
        if subject is None:
            return
        parameter = Parameter(subject, primitive.measures.id)
        self.conversions.append(
            (path, parameter, all(parameter != g for _, g, _ in self.conversions))
        )
        if before.holding and before.holding != subject:
            self._helped.setdefault(before.holding, set()).add(parameter)

    def _arm_reaches(self, pose: Pose) -> bool:
        from palpate.robots.kinematics import reachable

        return reachable(self.scene.arm, pose, self.scene.pose_world_base)
