"""The walk over a tree: the symbolic state folded leaf by leaf, as a run would have it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from palpate.errors import InputError
from palpate.geometry.pose import Pose
from palpate.parameter import Parameter
from palpate.planning.check.case import Form
from palpate.planning.check.finding import Finding
from palpate.planning.check.instead import remedied
from palpate.planning.check.slides import unfelt
from palpate.planning.plan import Node
from palpate.scene.scene import Scene
from palpate.trace.samples import FORCES
from palpate.vocabulary.base import ConversionPrimitive, Primitive
from palpate.vocabulary.registry import Vocabulary
from palpate.vocabulary.state import SymbolicState, during, parallel
from palpate.vocabulary.violation import PRECONDITION, Violation

Reach = Callable[[Pose], bool]

CONSEQUENCES = (PRECONDITION, "gripper-state", "unknown-start")
"""Rules that are not held against a plan after a motion to nowhere: they would follow from it."""
OF_THE_WAY = ("blocked", "collision", "self-collision", "sideways")
"""Rules that are not held against a motion from where the arm does not get, or with fingers that did not
take what they should."""
FAILING = ("buffer-unwritten", "gripper-state", PRECONDITION, "unknown-symbol")
"""Rules of which one that is broken may leave something unmeasured."""
OF_ITSELF = ("unknown-symbol", "unreachable")
"""Rules of an action by itself, whatever came before."""


@dataclass(frozen=True, slots=True, eq=False)
class Action:
    """Leaf with the states before it and after its success."""

    path: str
    primitive: Primitive
    before: SymbolicState
    after: SymbolicState

    @property
    def conversion(self) -> Parameter | None:
        """Conversion that it performs, if any."""
        if not isinstance(self.primitive, ConversionPrimitive) or self.primitive.measures is None:
            return None
        subject = self.primitive.subject(self.before)
        return Parameter(subject, self.primitive.measures.id) if subject is not None else None

    @property
    def records(self) -> bool:
        """True if it fills a buffer."""
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
        words: the vocabulary that it may use.
        state: what is believed after the part walked so far.
        actions: its leaves where they stand, sensing branches of a Parallel before its motion.
        findings: what speaks against single actions at their places.
    """

    form: Form
    words: Vocabulary
    state: SymbolicState
    actions: list[Action] = field(default_factory=list[Action])
    findings: list[Finding] = field(default_factory=list[Finding])
    unread: bool = False
    """There was an action that cannot be read: what came of it nobody knows."""
    failed: bool = False
    """An action would not get or leave what it should; what lacks later may follow from that."""
    _lost: bool = False
    """The hand was sent to a pose that does not exist."""
    _astray: bool = False
    """The hand was sent to where the arm does not get."""
    _empty: bool = False
    """The fingers were to take what they do not."""

    @classmethod
    def over(
        cls,
        tree: Node,
        form: Form,
        words: Vocabulary,
        scene: Scene,
        reachable: Reach | None = None,
        bound: Mapping[str, float] | None = None,
    ) -> Walk:
        """The walk of a whole tree; `reachable` replaces the arm's inverse kinematics, `bound` says
        where poses are that a run finds out (`SymbolicState.bound`)."""
        walk = cls(form, words, SymbolicState(scene, reaches=reachable, bound=bound or {}))
        walk._walk("tree", tree)
        return walk

    def doubts(self, path: str) -> bool:
        """True if a slide that a leaf is to feel has a finding: what it logs will be another thing."""
        return any(
            found.rule == "short-slide" and path.startswith(f"{found.path}.")
            for found in self.findings
        )

    def _walk(self, path: str, node: Node) -> None:
        if path in self.form.primitives:
            self.state = self._leaf(path, self.state)
            self.unread |= bool(node.children)
        elif not node.children and node.type not in self.words.composites:
            self.unread = True
        elif node.type == "Parallel" and self._has_one_owner(path):
            self.state = self._parallel(path, node, self.state)
        else:
            for i, child in enumerate(node.children):
                self._walk(f"{path}.children[{i}]", child)

    def _has_one_owner(self, path: str) -> bool:
        return all(len(owners) == 1 for owners in self.form.owners(path).values())

    def _parallel(self, path: str, node: Node, before: SymbolicState) -> SymbolicState:
        """Walk a Parallel: one branch may move; the others sense meanwhile."""
        moving = [where for where in self._below(path) if self.form.primitives[where].claims]
        try:
            meanwhile = during([self.form.primitives[where] for where in moving], before)
        except InputError:
            meanwhile = before  # the leaf with the pose that does not exist says so itself
        branches: list[Sequence[str]] = []
        for i, _ in enumerate(node.children):
            branch = self._below(f"{path}.children[{i}]")
            branches.append([where for where in branch if where not in moving])
        self._judge_together(path, moving, before)
        after = parallel(before, meanwhile, moving, branches, self._leaf)
        if any(self.form.primitives[where].writes == FORCES for where in self._below(path)):
            violation = unfelt(before, after)
            if violation is not None:
                self.failed = True
                self.findings.append(Finding(path, violation))
        return after

    def _judge_together(self, path: str, moving: Sequence[str], before: SymbolicState) -> None:
        """Leaves that move at once overlap in time, so each is also judged as if all others had
        come first; and nothing is taken or let go of under way."""
        firsts: dict[str, SymbolicState] = {}
        for where in moving:
            try:
                first = before
                for other in moving:
                    if other != where:
                        first = self.form.primitives[other].effects(first)
                ends = [self.form.primitives[where].effects(state) for state in (before, first)]
            except InputError:
                continue
            firsts[where] = first
            held = {end.holding for end in ends} - {before.holding}
            if len(moving) > 1 and "gripper" in self.form.primitives[where].claims and held:
                name = before.holding or max(filter(None, held))
                message = (
                    f"the fingers would take or let go of '{name}' while the arm moves; put the "
                    "two after one another, in a Sequence"
                )
                self.findings.append(Finding.of(path, "gripper-state", message))
                return
        for where, first in firsts.items():
            self._judge(where, first)

    def _below(self, path: str) -> Iterator[str]:
        """Paths of the leaves below and including `path`."""
        for where in self.form.primitives:
            if where == path or where.startswith(f"{path}."):
                yield where

    def _leaf(self, path: str, before: SymbolicState) -> SymbolicState:
        primitive = self.form.primitives[path]
        rules = self._judge(path, before)
        self.failed |= not rules.isdisjoint(FAILING)
        if "arm" in primitive.claims:
            self._astray = "unreachable" in rules
        if "gripper" in primitive.claims:
            self._empty = "gripper-state" in rules and not before.holding
        try:
            after = primitive.effects(before)
        except InputError:
            self._lost = True
            return replace(before, pose_world_tcp=None, at=None)
        if "arm" in primitive.claims and after.at is not None:
            self._lost = False
        self.actions.append(Action(path, primitive, before, after))
        return after

    def _judge(self, path: str, before: SymbolicState) -> set[str]:
        """Note what speaks against a leaf at its place, with what to do instead; the rules broken."""
        primitive = self.form.primitives[path]
        # No way leads from where the arm cannot be.
        moves = "arm" in primitive.claims
        found = (
            primitive.requires(before) if self._astray and moves else primitive.violations(before)
        )
        told = [violation for violation in found if not self._follows(primitive, violation)]
        for violation in remedied(primitive, before, told):
            self.findings.append(Finding(path, violation))
        return {violation.rule for violation in found}

    def _follows(self, primitive: Primitive, violation: Violation) -> bool:
        """True if that may come of an earlier fault alone, and is told once that is mended."""
        if violation.rule in OF_ITSELF:
            return False
        if self.unread or (self._lost and violation.rule in CONSEQUENCES):
            return True
        converts = isinstance(primitive, ConversionPrimitive)
        if self.failed and converts and violation.rule == PRECONDITION:
            return True
        nowhere = self._astray or self._empty
        return nowhere and violation.rule in OF_THE_WAY and "arm" in primitive.claims
