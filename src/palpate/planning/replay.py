"""Plans from files: a plan, a run folder, or the recorded conversation with a model. No network."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from palpate.errors import InputError
from palpate.planning.plan import MAX_BYTES, Plan, parse_plan
from palpate.scene.scene import Scene

MAX_CONVERSATION = 20 * MAX_BYTES


@dataclass(frozen=True, slots=True)
class ReplayPlanner:
    """A recorded plan, or a recorded conversation whose answers are checked anew."""

    path: Path
    remeasure: bool = False

    @property
    def name(self) -> str:
        """As written on the command line."""
        return f"replay:{self.path}"

    def plan(self, request: str | None, scene: Scene, images: Sequence[Path] = ()) -> Plan:
        """The plan in the file; the request and the images are not looked at.

        Raises:
            InputError: no such file, or not a plan. PlanRejected: no answer of the conversation passes the check.
        """
        text = _read(plan_file(self.path))
        if _is_conversation(text):
            return replace(self._from_conversation(scene), planner=self.name)
        plan = parse_plan(text)
        return plan if plan.planner else replace(plan, planner="replay")

    def _from_conversation(self, scene: Scene) -> Plan:
        from palpate.planning.conversation import replay
        from palpate.planning.vlm import VlmPlanner

        judge = VlmPlanner("replay", remeasure=self.remeasure)
        return replay(plan_file(self.path), lambda text: judge.judge(text, scene))


def load_plan(path: Path) -> Plan:
    """The plan in a plan file or a run folder.

    Raises:
        InputError: no such file, or not a plan.
    """
    return parse_plan(_read(plan_file(path)))


def plan_file(path: Path) -> Path:
    """The plan's file: `path` itself, or `plan.json` in a run folder.

    Raises:
        InputError: there is none.
    """
    found = path / "plan.json" if path.is_dir() else path
    if not found.is_file():
        what = f"the folder '{path}' has no plan.json" if path.is_dir() else f"there is no plan file '{path}'"
        raise InputError(f"{what}; give a plan (JSON) or the folder of a run")
    return found


def _read(path: Path) -> bytes:
    try:
        if path.stat().st_size > MAX_CONVERSATION:
            raise InputError(f"'{path}' is larger than {MAX_CONVERSATION // MAX_BYTES} MB; it is not a plan")
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"the plan '{path}' cannot be read: {error.strerror or error}") from None


def _is_conversation(text: bytes) -> bool:
    """A conversation begins with who was asked; a plan never does."""
    start = text.lstrip()[:200]
    return start.startswith(b"{") and b'"planner"' in start and b'"system"' in start and b'"rounds"' in text
