"""Walk over a tree: update of the symbolic state leaf by leaf, as in a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.common.pose import Pose
from palpate.planning.check.finding import CheckedPlan, Finding
from palpate.planning.check.remedies import offer_remedies, unfelt_slide
from palpate.planning.plan import Node
from palpate.primitives.base import ConversionPrimitive, Primitive
from palpate.primitives.state import PRECONDITION, SymbolicState, Violation, during, parallel
from palpate.trace.samples import FORCES

Reach = Callable[[Pose], bool]
MAX_FINDINGS = 50  # Maximum number of reported findings; later actions are not tested
# Rules that are not reported after a motion to an unknown pose, because they follow from it.
CONSEQUENCES = (PRECONDITION, "gripper-state", "unknown-start")
# Rules that are not reported for a motion from an unreachable pose or after a failed grasp.
PATH_RULES = ("blocked", "collision", "self-collision")
# Rules that may leave a parameter unmeasured when broken.
FAILING = ("buffer-unwritten", "gripper-state", PRECONDITION, "unknown-symbol")
# Rules that an action breaks independently of earlier actions.
INDEPENDENT = ("unknown-symbol", "unreachable")


@dataclass(frozen=True, slots=True, eq=False)
class WalkedAction:
    """Leaf with the states before and after its success."""

    path: str
    primitive: Primitive
    before: SymbolicState
    after: SymbolicState

    @property
    def conversion(self) -> Parameter | None:
        if not isinstance(self.primitive, ConversionPrimitive) or self.primitive.measures is None:
            return None
        subject = self.primitive.subject(self.before)
        return Parameter(subject, self.primitive.measures.id) if subject is not None else None

    @property
    def records(self) -> bool:
        """True if it fills a buffer."""
        logged = len(self.after.logged) > len(self.before.logged)
        return self.primitive.writes is not None and logged

    @property
    def grasps(self) -> str | None:
        """Object that it grasps, if any."""
        name = self.after.holding
        return name if name != self.before.holding else None


@dataclass(eq=False)
class Walk:
    """Fold of a tree over the symbolic state of a scene."""

    case: CheckedPlan  # the plan, with its tree read
    state: SymbolicState  # the believed state after the part walked so far
    # The leaves in order; sensing branches of a Parallel before its motion.
    actions: list[WalkedAction] = field(default_factory=list[WalkedAction])
    # Violations of single actions, with paths.
    findings: list[Finding] = field(default_factory=list[Finding])
    unread: bool = False
    """An action is unreadable, so its effect is unknown."""
    failed: bool = False
    """An action broke a rule of `FAILING`; missing measurements may follow from it."""
    _lost: bool = False
    """The last target of the hand is an unknown pose."""
    _astray: bool = False
    """The last target of the hand is unreachable."""
    _empty: bool = False
    """The last grasp failed."""

    @classmethod
    def over(
        cls,
        case: CheckedPlan,
        reachable: Reach | None = None,
        bound: Mapping[str, float] | None = None,
    ) -> Walk:
        """Walk over the whole tree of a plan in its scene.

        Args:
            case: the plan under check.
            reachable: replaces the arm's inverse kinematics.
            bound: places the estimated poses (`SymbolicState.bound`).
        """
        assert case.plan.tree is not None
        assert case.scene is not None
        walk = cls(case, SymbolicState(case.scene, reaches=reachable, bound=bound or {}))
        walk._walk("tree", case.plan.tree)
        return walk

    @property
    def full(self) -> bool:
        """True if no further finding would be reported."""
        return len(self.findings) >= MAX_FINDINGS and len(set(self.findings)) >= MAX_FINDINGS

    @property
    def leaves(self) -> Mapping[str, Primitive]:
        """Primitives of the leaves, by path."""
        return self.case.form.primitives

    def conversions(self) -> Iterator[tuple[WalkedAction, Parameter]]:
        """Yield the actions that convert a recording, with their parameters."""
        for action in self.actions:
            if (parameter := action.conversion) is not None:
                yield action, parameter

    def has_doubt_about(self, path: str) -> bool:
        """True if a leaf logs a slide that has a finding, so its recording will change."""
        return any(
            finding.rule == "short-slide" and path.startswith(f"{finding.path}.")
            for finding in self.findings
        )

    def _walk(self, path: str, node: Node) -> None:
        # A valid leaf updates the state. Children of a leaf are not executed.
        if path in self.leaves:
            self.state = self._leaf(path, self.state)
            self.unread |= bool(node.children)
        elif not node.children and node.type not in self.case.words.composites:
            self.unread = True
        # A Parallel with one owner per resource runs its branches together.
        elif node.type == "Parallel" and all(
            len(owners) == 1 for owners in self.case.form.owners(path).values()
        ):
            self.state = self._parallel(path, node, self.state)
        else:  # a Sequence, or a Parallel with a finding on its owners
            for i, child in enumerate(node.children):
                self._walk(f"{path}.children[{i}]", child)

    def _below(self, path: str) -> list[str]:
        """Return the paths of the leaves at and below `path`."""
        return [where for where in self.leaves if where == path or where.startswith(f"{path}.")]

    def _parallel(self, path: str, node: Node, before: SymbolicState) -> SymbolicState:
        """Walk a Parallel: one branch may move while the others sense."""
        # Derive the state during the motion; the sensing branches see this state.
        below = self._below(path)
        moving = [where for where in below if self.leaves[where].claims]
        try:
            meanwhile = during([self.leaves[where] for where in moving], before)
        except InputError:
            meanwhile = before  # the leaf with the unknown pose has a finding
        # Collect the sensing leaves branch by branch, then judge the moving ones together.
        branches: list[Sequence[str]] = []
        for i, _ in enumerate(node.children):
            branch = self._below(f"{path}.children[{i}]")
            branches.append([where for where in branch if where not in moving])
        self._judge_together(path, moving, before)
        after = parallel(before, meanwhile, moving, branches, self._leaf)
        # A drag during a force log must be a valid slide.
        if any(self.leaves[where].writes == FORCES for where in below):
            violation = unfelt_slide(before, after)
            if violation is not None:
                self.failed = True
                self.findings.append(Finding(path, violation.rule, violation.message))
        return after

    def _judge_together(self, path: str, moving: Sequence[str], before: SymbolicState) -> None:
        """Judge leaves that move at the same time."""
        # The motions overlap in time. Judge each one also in the state after all the others.
        firsts: dict[str, SymbolicState] = {}
        for where in moving:
            primitive = self.leaves[where]
            try:
                # State after all other motions have ended.
                first = before
                for other in moving:
                    if other != where:
                        first = first.after(self.leaves[other])
                ends = [state.after(primitive) for state in (before, first)]
            except InputError:
                continue
            firsts[where] = first
            # The fingers neither grasp nor release during an arm motion.
            names = {end.holding for end in ends} - {before.holding}
            if len(moving) > 1 and "gripper" in primitive.claims and names:
                name = before.holding or max(filter(None, names))
                message = f"the fingers would grasp or release '{name}' while the arm moves; put both into a Sequence"
                self.findings.append(Finding(path, "gripper-state", message))
                return
        # Judge each motion after the others as well.
        for where, first in firsts.items():
            self._judge(where, first)

    def _leaf(self, path: str, before: SymbolicState) -> SymbolicState:
        primitive = self.leaves[path]
        # Record which rules failed, to suppress findings that only follow from them.
        broken = self._judge(path, before)
        self.failed |= not broken.isdisjoint(FAILING)
        if "arm" in primitive.claims:
            self._astray = "unreachable" in broken
        if "gripper" in primitive.claims:
            self._empty = "gripper-state" in broken and not before.holding
        # An unknown pose leaves the hand at an unknown place.
        try:
            after = before.after(primitive)
        except InputError:
            self._lost = True
            return replace(before, pose_world_tcp=None, at=None)
        if "arm" in primitive.claims and after.at is not None:
            self._lost = False  # a known pose again
        self.actions.append(WalkedAction(path, primitive, before, after))
        return after

    def _judge(self, path: str, before: SymbolicState) -> set[str]:
        """Add the findings on a leaf in a state, with remedies; return all broken rules, also unreported ones."""
        primitive = self.leaves[path]
        if self.full:
            return set()
        if self._astray and "arm" in primitive.claims:
            violations = primitive.requires(before)  # no path leads from an unreachable pose
        else:
            violations = primitive.violations(before)
        # Suppress findings that only follow from earlier ones.
        reported = [v for v in violations if not self._follows(primitive, v)]
        for v in offer_remedies(primitive, before, reported):
            self.findings.append(Finding(path, v.rule, v.message))
        return {v.rule for v in violations}

    def _follows(self, primitive: Primitive, violation: Violation) -> bool:
        """True if a violation may follow from an earlier fault; it is not reported then."""
        if violation.rule in INDEPENDENT:
            return False
        # The state itself is unknown: any violation may follow from it.
        if self.unread or (self._lost and violation.rule in CONSEQUENCES):
            return True
        # A conversion without its recording may follow from a failed recording.
        converts = isinstance(primitive, ConversionPrimitive)
        if self.failed and converts and violation.rule == PRECONDITION:
            return True
        misplaced = self._astray or self._empty
        return misplaced and violation.rule in PATH_RULES and "arm" in primitive.claims


def evidence_amount(parameter: Parameter, state: SymbolicState) -> int:
    """Number of pieces of evidence for `parameter`; the full number after its conversion."""
    quantity = state.scene.catalogue[parameter.quantity]
    # A conversion uses all the evidence that it needs.
    if parameter in state.converted:
        return max(sum(evidence.count for evidence in quantity.evidence), 1)
    return len(quantity.pieces(parameter, state.logged)) if quantity.derived else 0


def useful_evidence(parameter: Parameter, state: SymbolicState) -> int:
    """Number of pieces of evidence above which the estimate does not improve."""
    quantity = state.scene.catalogue[parameter.quantity]
    return sum(max(evidence.count, evidence.better) for evidence in quantity.evidence)


def has_measurement(parameter: Parameter, state: SymbolicState) -> bool:
    """True if `parameter` is converted, or derivable from complete recordings."""
    quantity = state.scene.catalogue[parameter.quantity]
    derivable = quantity.derived and quantity.is_evidenced(parameter, state.logged)
    return parameter in state.converted or derivable


def lacking(parameter: Parameter, state: SymbolicState) -> list[str]:
    """Name the recordings that a derived `parameter` still needs, with their counts so far."""
    quantity = state.scene.catalogue[parameter.quantity]
    kinds = Counter(kind for kind, _ in quantity.pieces(parameter, state.logged))
    return [
        f"{evidence.how} ({kinds[i]} of {evidence.count})"
        for i, evidence in enumerate(quantity.evidence)
        if kinds[i] < evidence.count and not evidence.optional
    ]
