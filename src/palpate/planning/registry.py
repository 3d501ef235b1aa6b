"""Registry of planners, and plans from files."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, TypeGuard

from palpate.common.errors import InputError, unknown_name
from palpate.common.extensions import Registry, iter_entry_points
from palpate.common.files import read_bytes
from palpate.planning.model.provider import PROVIDERS, ReportedError, complete_reply
from palpate.planning.plan import Plan, parse_plan
from palpate.planning.planner import Planner, PlannerKind, PlannerSettings
from palpate.primitives.registry import vocabulary
from palpate.scene.picture_scene import DetectedScene, SceneBuilder

if TYPE_CHECKING:
    from palpate.planning.model.answer import Proposal
    from palpate.planning.model.conversation import Conversation
    from palpate.scene.scene import Scene

# Start of an XML document. Tags of a model's reasoning start otherwise.
XML = re.compile(r"\s*<(\?xml\b|!(?=--|DOCTYPE)|(root|BehaviorTree|TreeNodesModel|mujoco)\b)")


@dataclass(slots=True)
class ReplayPlanner:
    """Replay of a recorded plan, or of a conversation whose answers are checked again.

    Attributes:
        path: the file, or the run folder.
        remeasure: allows measurement of quantities that the scene states.
        builder: makes a scene of detected objects, for a plan without a scene.
        conversation: the dialogue as checked again, if the file is one.
        seen: the detected scene, if there was no scene.
    """

    looks: ClassVar[bool] = False

    path: Path
    remeasure: bool = False
    builder: SceneBuilder | None = None
    conversation: Conversation | None = field(default=None, init=False)
    seen: DetectedScene | None = field(default=None, init=False)

    @property
    def name(self) -> str:
        return f"replay:{self.path}"

    def plan(self, request: str | None, scene: Scene | None, images: Sequence[Path] = ()) -> Plan:
        """Return the plan in the file. Without a scene, the images refine the detected one."""
        text = _read(plan_file(self.path))
        start = text.lstrip()[:200]
        # A conversation begins with the planner and the system prompt; a plan never does.
        begins = start.startswith(b"{") and b'"planner"' in start and b'"system"' in start
        if begins and b'"rounds"' in text:
            return replace(self._from_conversation(request, scene, images), planner=self.name)
        # A plan without a scene brings its detected objects: build the scene from them.
        proposal = read_proposal(text)
        if scene is None and proposal.scene and self.builder:
            self.seen = self.builder.from_detections(proposal.scene, images)
        plan = complete_parameters(proposal, scene)
        return plan if plan.planner else replace(plan, planner="replay")

    def _from_conversation(
        self, request: str | None, scene: Scene | None, images: Sequence[Path]
    ) -> Plan:
        """Check the recorded answers again; return the first plan that passes."""
        from palpate.planning.model.conversation import read_conversation
        from palpate.planning.model.planner import VlmPlanner
        from palpate.planning.model.rounds import replay_conversation

        # Check the recorded answers with the same code as in a dialogue.
        judge = VlmPlanner("replay", remeasure=self.remeasure, builder=self.builder)
        judge.images = tuple(images)
        kept = read_conversation(plan_file(self.path))
        if not kept.rounds:
            raise InputError(f"'{plan_file(self.path).name}' holds no answer")
        self.conversation = replace(kept, rounds=[])
        try:
            return replay_conversation(
                kept, self.conversation, lambda text: judge.judge(text, scene, request or "")
            )
        finally:
            self.seen = judge.seen


def load_proposal(path: Path) -> Proposal:
    """Load the plan of a plan file, run folder or chat answer, with the detected objects."""
    return read_proposal(_read(plan_file(path)))


def read_proposal(text: bytes) -> Proposal:
    """Read a plan from a file's content: JSON alone or in prose, or BT.CPP XML.

    Raises InputError: there is no plan, or it is not in the form of one.
    """
    from palpate.planning.btcpp import read_tree_xml
    from palpate.planning.model.answer import proposal_from, read_answer, reply_text

    # A provider's API may have answered with a stream, or with an error.
    try:
        decoded = (text if b'"tree"' in text else complete_reply(text)).decode("utf-8-sig")
    except ReportedError as error:
        raise InputError(f"the file has no plan, but a server's error: {error}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"the plan is not UTF-8 text (byte {error.start})") from None
    if XML.match(decoded):
        document = read_tree_xml(decoded.lstrip(), vocabulary())
        proposal = proposal_from({"parameters": [], **document})
        return replace(proposal, bare="parameters" not in document)
    try:
        return read_answer(decoded)
    except InputError:
        whole = decoded.lstrip().startswith(("{", "[")) and '"nodes"' not in decoded
        if "{" not in decoded or (whole and reply_text(decoded) == decoded):
            parse_plan(decoded)  # without prose, its error is clearer
        raise


def complete_parameters(proposal: Proposal, scene: Scene | None) -> Plan:
    """Return the plan; a bare tree gets the parameters that it measures in `scene`, or an `InputError`."""
    if not proposal.bare or scene is None:
        return proposal.plan
    from palpate.planning.check.finding import CheckedPlan
    from palpate.planning.check.walk import Walk, has_measurement

    # Conversions name their parameters. A derived quantity needs complete recordings.
    walk = Walk.over(CheckedPlan(proposal.plan, vocabulary(), scene))
    derived = (p for p in scene.missing if has_measurement(p, walk.state))
    measured = tuple(dict.fromkeys((*(p for _, p in walk.conversions()), *derived)))
    if not (measured or walk.findings or walk.unread):
        raise InputError(
            'the tree measures nothing that the scene lacks; to state its parameters, add <SubTree ID="TREE">'
            """<MetadataFields><Metadata plan='{"parameters": ["OBJECT.QUANTITY"]}'/></MetadataFields></SubTree> """
            "to <TreeNodesModel>"
        )
    note = f"the parameters follow from the tree: {', '.join(map(str, measured))}"
    return replace(proposal.plan, parameters=measured, notes=(note,))


def plan_file(path: Path) -> Path:
    """Return the file of a plan: `path` itself, or `plan.json` in a run folder; an `InputError` without one."""
    # A folder is a run folder with a plan.json.
    found, lacking = path, f"there is no plan file '{path}'"
    if path.is_dir():
        found, lacking = path / "plan.json", f"the folder '{path}' has no plan.json"
    if not found.exists():
        raise InputError(f"{lacking}; give a plan (JSON or XML) or the folder of a run")
    return found


def _read(path: Path) -> bytes:
    from palpate.planning.model.conversation import MAX_CONVERSATION

    return read_bytes(path, MAX_CONVERSATION, "a plan")


# Registry of planners: built-in planners, models, and those of other packages.


OWN = ("symbolic", "exhaustive")  # Planners with plans made by palpate itself


class Planners(Registry[PlannerKind]):
    """Kinds of planners by name, in listing order."""

    kind = "planner"

    def make(self, spec: str, settings: PlannerSettings | None = None) -> Planner:
        """Make the planner of a `spec` such as `symbolic`, `replay:FILE` or `openai:MODEL`."""
        # The part after the colon is the argument of the factory.
        name, _, argument = spec.partition(":")
        kind = self.get(name)
        if kind is None or not kind.accepts(spec):
            raise unknown_name("planner", spec, [known.form for known in self.values()])
        return kind.make(argument, settings or PlannerSettings())


@cache
def planners() -> Planners:
    """Return palpate's planners and those of the entry-point group `palpate.planners`.

    An entry point names a module. Every public planner class and every public `PlannerKind` in it
    is registered under its name. Built-in names cannot be replaced.
    Raises InputError: the module of an entry point cannot be loaded; the message names it.
    """
    kinds = [
        PlannerKind("symbolic", _symbolic),
        PlannerKind("exhaustive", _exhaustive),
        PlannerKind("replay", _replay, "FILE"),
    ]
    for provider in PROVIDERS:
        kinds.append(PlannerKind(provider, partial(_model, provider), "MODEL", optional=True))
    # Other packages add kinds. A planner class is wrapped in a factory without arguments.
    for part in iter_entry_points("palpate.planners"):
        if isinstance(part, PlannerKind):
            kinds.append(part)
        elif isinstance(part, type) and is_planner(part):
            kinds.append(PlannerKind(vars(part)["name"], partial(_without_arguments, part)))
    return Planners([(kind.name, kind) for kind in kinds])


def is_planner(cls: type) -> TypeGuard[type[Planner]]:
    """True if a class has the members of `Planner`, with a constant name."""
    return isinstance(vars(cls).get("name"), str) and callable(getattr(cls, "plan", None))


# Factories. Each imports its planner on demand, so that a command loads no other.


def _without_arguments(cls: type[Planner], argument: str, settings: PlannerSettings) -> Planner:
    return cls()


def _symbolic(argument: str, settings: PlannerSettings) -> Planner:
    from palpate.planning.symbolic.planner import SymbolicPlanner

    return SymbolicPlanner(settings.remeasure, settings.within, settings.measure)


def _exhaustive(argument: str, settings: PlannerSettings) -> Planner:
    from palpate.planning.symbolic.planner import ExhaustivePlanner

    return ExhaustivePlanner()


def _replay(argument: str, settings: PlannerSettings) -> Planner:

    return ReplayPlanner(Path(argument), settings.remeasure, settings.builder)


def _model(provider: str, argument: str, settings: PlannerSettings) -> Planner:
    from palpate.planning.model.planner import VlmPlanner
    from palpate.planning.model.settings import ModelSettings

    # Without an argument, the provider's default model applies.
    spec = f"{provider}:{argument}" if argument else provider
    model_settings = settings.model_settings or ModelSettings()
    return VlmPlanner(
        spec,
        model_settings,
        settings.remeasure,
        settings.builder,
        settings.measure,
        settings.rehearse,
    )
