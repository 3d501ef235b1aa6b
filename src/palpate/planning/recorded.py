"""Plans from files, without network: a plan, a run folder, a chat's answer, or a recorded conversation
with a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from palpate.errors import InputError
from palpate.files.read import read_bytes
from palpate.planning.plan import Plan, parse_plan
from palpate.scene.pictured.detected import DetectedScene, SceneBuilder

if TYPE_CHECKING:
    from palpate.planning.model.answer import Proposal
    from palpate.planning.model.conversation import Conversation
    from palpate.scene.scene import Scene


@dataclass(slots=True)
class ReplayPlanner:
    """Recorded plan, or recorded conversation whose answers are checked again.

    Attributes:
        path: the file, or the run folder.
        remeasure: allows quantities that the scene states to be measured.
        builder: makes a scene of detected objects, for a plan without a scene.
        conversation: the dialogue as checked again, when the file is one.
        seen: the detected scene, when there was no scene.
    """

    looks: ClassVar[bool] = False

    path: Path
    remeasure: bool = False
    builder: SceneBuilder | None = None
    conversation: Conversation | None = field(default=None, init=False)
    seen: DetectedScene | None = field(default=None, init=False)

    @property
    def name(self) -> str:
        """Name on the command line."""
        return f"replay:{self.path}"

    def plan(self, request: str | None, scene: Scene | None, images: Sequence[Path] = ()) -> Plan:
        """The plan in the file; the images refine the detected scene, where there is no other.

        Raises:
            InputError: no such file, or not a plan.
            PlanRejected: no answer of the conversation passes the check.
        """
        text = _read(plan_file(self.path))
        start = text.lstrip()[:200]
        # A conversation begins with the planner and the system prompt; a plan never does.
        begins = start.startswith(b"{") and b'"planner"' in start and b'"system"' in start
        if begins and b'"rounds"' in text:
            return replace(self._from_conversation(request, scene, images), planner=self.name)
        proposal = read_proposal(text)
        if scene is None and proposal.scene and self.builder:
            self.seen = self.builder.detected(proposal.scene, images)
        if proposal.plan.planner:
            return proposal.plan
        return replace(proposal.plan, planner="replay")

    def _from_conversation(
        self, request: str | None, scene: Scene | None, images: Sequence[Path]
    ) -> Plan:
        from palpate.planning.model.conversation import read_conversation
        from palpate.planning.model.planner import VlmPlanner
        from palpate.planning.model.rounds import replayed

        judge = VlmPlanner("replay", remeasure=self.remeasure, builder=self.builder)
        judge.images = tuple(images)
        kept = read_conversation(plan_file(self.path))
        if not kept.rounds:
            raise InputError(f"'{plan_file(self.path).name}' holds no answer")
        self.conversation = replace(kept, rounds=[])
        try:
            return replayed(
                kept, self.conversation, lambda text: judge.judge(text, scene, request or "")
            )
        finally:
            self.seen = judge.seen


def load_proposal(path: Path) -> Proposal:
    """Load the plan in a plan file, a run folder or a chat's answer, with the objects that a model saw.

    Raises:
        InputError: no such file, or not a plan.
    """
    return read_proposal(_read(plan_file(path)))


def read_proposal(text: bytes) -> Proposal:
    """The plan in a file's content: JSON alone, or amid a chat's prose.

    Raises:
        InputError: there is none.
    """
    from palpate.planning.model.answer import read_answer

    try:
        return read_answer(text.decode("utf-8-sig"))
    except UnicodeDecodeError:
        parse_plan(text)  # raises with the byte that is no text
        raise
    except InputError:
        if b"{" not in text or text.lstrip().startswith((b"{", b"[")):
            parse_plan(text)  # without a chat's prose, the fault of the plan itself is clearer
        raise


def plan_file(path: Path) -> Path:
    """The plan's file: `path` itself, or `plan.json` in a run folder.

    Raises:
        InputError: there is none.
    """
    found, lacking = path, f"there is no plan file '{path}'"
    if path.is_dir():
        found, lacking = path / "plan.json", f"the folder '{path}' has no plan.json"
    if not found.exists():
        raise InputError(f"{lacking}; give a plan (JSON) or the folder of a run")
    return found


def _read(path: Path) -> bytes:
    from palpate.planning.model.conversation import MAX_CONVERSATION

    return read_bytes(path, MAX_CONVERSATION, "a plan")
