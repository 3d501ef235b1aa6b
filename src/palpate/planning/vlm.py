"""f(S, D, R, I) → behavior tree: a vision-language model as a planner, whoever provides it.

Keys come from the environment and are blotted out of every message; what is recorded is words and figures.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.errors import InputError
from palpate.planning import flat
from palpate.planning.conversation import FEEDBACK_ROUNDS, Conversation, converse
from palpate.planning.extract import Proposal, SceneObject, read_answer
from palpate.planning.picture import picture
from palpate.planning.plan import Plan
from palpate.planning.prompt.compose import Prompt, compose
from palpate.planning.provider import find_provider
from palpate.planning.session import Budget, Session
from palpate.vocabulary.primitive import vocabulary

if TYPE_CHECKING:
    from palpate.scene.scene import Scene
    from palpate.scene.symbols import Symbols


@dataclass(slots=True)
class VlmPlanner:
    """A model as a planner.

    Attributes:
        model: `PROVIDER:MODEL`, or `PROVIDER` alone for its default.
        base_url: where an OpenAI-compatible server, or a proxy, listens; the provider's own if None.
        native: ask for the provider's structured output, in the flat form, instead of JSON in prose.
        without: prompt modules and inputs to leave out (ablation).
        rounds: how often findings are fed back.
        build: makes a scene of the objects a model saw, for a request without D.
        conversation: the latest dialogue, also when `plan` raised.
    """

    model: str
    base_url: str | None = None
    native: bool = False
    without: frozenset[str] = frozenset()
    remeasure: bool = False
    rounds: int = FEEDBACK_ROUNDS
    budget: Budget = field(default_factory=Budget)
    build: Callable[[tuple[SceneObject, ...]], Scene] | None = None
    conversation: Conversation | None = field(default=None, init=False)

    @property
    def name(self) -> str:
        """As written on the command line."""
        return self.model

    def plan(self, request: str | None, scene: Scene | None, images: Sequence[Path] = (),
             symbols: Symbols | None = None) -> Plan:
        """The first plan of the model that passes the check. Without a scene, `symbols` name the poses.

        Raises:
            InputError: unknown provider or module, unreadable image.
            Unavailable: no extra, no key, provider out of reach or refusing, time used up.
            PlanRejected: the model gave no valid plan.
        """
        provider, model = find_provider(self.model)
        provider.require_key()
        prompt = self._prompt(request or "", scene, images, symbols)
        pictures = [picture(path) for path in prompt.images]
        self.conversation = Conversation(f"{provider.name}:{model}", prompt.system,
                                         tuple(p.note() for p in pictures))
        schema = flat.flat_schema(vocabulary(), with_scene=scene is None) if self.native else None
        session = Session(provider, model, provider.address(self.base_url), prompt.system, pictures, schema,
                           self.budget)
        plan = converse(self.conversation, prompt.user, session.ask, lambda text: self.judge(text, scene),
                        self.rounds, self.budget.exhausted)
        return replace(plan, planner=self.conversation.planner)

    def judge(self, text: str, scene: Scene | None) -> tuple[Plan | None, list[str]]:
        """The plan in an answer and what the check finds wrong with it."""
        try:
            proposal = read_answer(text)
            return proposal.plan, self._findings(proposal, scene)
        except InputError as error:
            return None, [str(error)]

    def _prompt(self, request: str, scene: Scene | None, images: Sequence[Path], symbols: Symbols | None) -> Prompt:
        prompt = compose(vocabulary(), request, scene, images, symbols, self.without)
        return replace(prompt, user=f"{prompt.user}\n\n{flat.NOTE}") if self.native else prompt

    def _findings(self, proposal: Proposal, scene: Scene | None) -> list[str]:
        from palpate.planning.check import check

        plan = proposal.plan
        if plan.tree is not None and scene is None:
            scene = self._seen(proposal.scene)
        return [f"{f.path}: {f.message}" for f in check(plan, scene, remeasure=self.remeasure)]

    def _seen(self, objects: tuple[SceneObject, ...]) -> Scene:
        if self.build is None:
            raise InputError("there is no simulation description to check the plan against; give one with --scene")
        if not objects:
            raise InputError("'scene' is missing: there is no D, so list the objects that the image shows")
        return self.build(objects)
