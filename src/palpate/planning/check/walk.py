"""The walk over a tree: the symbolic state folded leaf by leaf, as a run would have it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from palpate.errors import InputError
from palpate.geometry.pose import Pose
from palpate.parameter import Parameter
from palpate.planning.check.case import Form
from palpate.planning.check.finding import Finding
from palpate.planning.check.slides import unfelt
from palpate.planning.plan import Node
from palpate.scene.scene import Scene
from palpate.trace.samples import FORCES
from palpate.vocabulary.base import ConversionPrimitive, Primitive
from palpate.vocabulary.state import SymbolicState, during, parallel

Reach = Callable[[Pose], bool]

CONSEQUENCES = ("precondition", "gripper-state", "unknown-start")
"""Rules that are not held against a plan after a motion to nowhere: they would follow from it."""


@dataclass(frozen=True, slots=True, eq=False)
class Action:
    """One leaf where it stands: the states before it and after its success."""

    path: str
    primitive: Primitive
    before: SymbolicState
    after: SymbolicState

    @property
    def conversion(self) -> Parameter | None:
        """What it yields, if anything."""
        if not isinstance(self.primitive, ConversionPrimitive) or self.primitive.measures is None:
            return None
        subject = self.primitive.subject(self.before)
        return Parameter(subject, self.primitive.measures.id) if subject is not None else None

    @property
    def records(self) -> bool:
        """Whether it fills a buffer."""
        return self.primitive.writes is not None and len(self.after.logged) > len(
            self.before.logged
        )

    @property
    def grasps(self) -> str | None:
        """The object that it takes into the hand."""
        held = self.after.holding
        return held if held != self.before.holding else None


@dataclass(eq=False)
class Walk:
    """A tree folded over the symbolic state of a scene.

    Attributes:
        form: the tree, read.
        state: what is believed after the part walked so far.
        actions: its leaves where they stand, sensing branches of a Parallel before its motion.
        findings: what speaks against single actions at their places.
    """

    form: Form
    state: SymbolicState
    actions: list[Action] = field(default_factory=list[Action])
    findings: list[Finding] = field(default_factory=list[Finding])
    _lost: bool = False
    """The hand was sent to a pose that does not exist."""

    @classmethod
    def over(cls, tree: Node, form: Form, scene: Scene, reachable: Reach | None) -> Walk:
        """The walk of a whole tree; `reachable` replaces the arm's inverse kinematics."""
        walk = cls(form, SymbolicState(scene, reaches=reachable))
        walk._walk("tree", tree)
        return walk

    def doubts(self, path: str) -> bool:
        """Whether a slide that a leaf is to feel has a finding: what it logs will be another thing."""
        return any(
            found.rule == "short-slide" and path.startswith(f"{found.path}.")
            for found in self.findings
        )

    def _walk(self, path: str, node: Node) -> None:
        if path in self.form.primitives:
            self.state = self._leaf(path, self.state)
        elif node.type == "Parallel" and self._has_one_owner(path):
            self.state = self._parallel(path, node, self.state)
        else:
            for i, child in enumerate(node.children):
                self._walk(f"{path}.children[{i}]", child)

    def _has_one_owner(self, path: str) -> bool:
        return all(len(owners) == 1 for owners in self.form.owners(path).values())

    def _parallel(self, path: str, node: Node, before: SymbolicState) -> SymbolicState:
        """One branch may move; the others sense what is so meanwhile."""
        moving = [where for where in self._below(path) if self.form.primitives[where].claims]
        try:
            meanwhile = during([self.form.primitives[where] for where in moving], before)
        except InputError:
            meanwhile = before  # the leaf with the pose that does not exist says so itself
        branches: list[Sequence[str]] = []
        for i, _ in enumerate(node.children):
            branch = self._below(f"{path}.children[{i}]")
            branches.append([where for where in branch if where not in moving])
        self._judge_together(moving, before)
        after = parallel(before, meanwhile, moving, branches, self._leaf)
        if any(self.form.primitives[where].writes == FORCES for where in self._below(path)):
            violation = unfelt(before, after)
            if violation is not None:
                self.findings.append(Finding(path, violation))
        return after

    def _judge_together(self, moving: Sequence[str], before: SymbolicState) -> None:
        """Leaves that move at once overlap in time, so each is also judged as if all others had
        come first; and nothing is taken or let go of under way."""
        for path in moving:
            others = [where for where in moving if where != path]
            try:
                first = before
                for where in others:
                    first = self.form.primitives[where].effects(first)
                self._judge(path, first)
                ends = [self.form.primitives[path].effects(state) for state in (before, first)]
            except InputError:
                continue
            held = {end.holding for end in ends} - {before.holding}
            if others and "gripper" in self.form.primitives[path].claims and held:
                name = before.holding or max(filter(None, held))
                message = (
                    f"the fingers would take or let go of '{name}' while the arm moves; put the "
                    "two after one another, in a Sequence"
                )
                self.findings.append(Finding.of(path, "gripper-state", message))

    def _below(self, path: str) -> Iterator[str]:
        """Paths of the leaves below and including `path`."""
        for where in self.form.primitives:
            if where == path or where.startswith(f"{path}."):
                yield where

    def _leaf(self, path: str, before: SymbolicState) -> SymbolicState:
        primitive = self.form.primitives[path]
        self._judge(path, before)
        try:
            after = primitive.effects(before)
        except InputError:
            self._lost = True
            return replace(before, pose_world_tcp=None, at=None)
        if "arm" in primitive.claims and after.at is not None:
            self._lost = False
        self.actions.append(Action(path, primitive, before, after))
        return after

    def _judge(self, path: str, before: SymbolicState) -> None:
        """Note what speaks against a leaf at its place."""
        for violation in self.form.primitives[path].violations(before):
            if not (self._lost and violation.rule in CONSEQUENCES):
                self.findings.append(Finding(path, violation))
