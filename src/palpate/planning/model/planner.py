"""A vision-language model as a planner, whoever provides it.

Keys come from the environment and are blotted out of every message; what is recorded is words and
figures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from palpate.errors import InputError
from palpate.parameter import Parameter
from palpate.planning.model import flat
from palpate.planning.model.answer import Proposal, read_answer
from palpate.planning.model.dialogue.conversation import Conversation
from palpate.planning.model.dialogue.critic import Critic
from palpate.planning.model.dialogue.rounds import converse
from palpate.planning.model.picture import picture
from palpate.planning.model.prompt.compose import Prompt, compose
from palpate.planning.model.provider import Endpoint
from palpate.planning.model.session import Session
from palpate.planning.model.settings import ModelSettings
from palpate.planning.plan import Plan
from palpate.planning.symbolic.planner import requested
from palpate.scene.pictured.detected import DetectedScene, SceneBuilder
from palpate.scene.pictured.objects import SceneObject
from palpate.vocabulary.registry import vocabulary

if TYPE_CHECKING:
    from palpate.scene.scene import Scene
    from palpate.scene.symbols import Symbols


@dataclass(slots=True)
class VlmPlanner:
    """A model as a planner.

    Attributes:
        model: `PROVIDER:MODEL`, or `PROVIDER` alone for its default.
        model_settings: address, form, feedback and budget.
        builder: makes a scene of what the model saw, for a request without a scene.
        conversation: the latest dialogue, also when `plan` raised.
        seen: what the model saw, when there was no scene.
        images: what it looked at, which sharpens what it saw.
    """

    looks: ClassVar[bool] = True

    model: str
    model_settings: ModelSettings = field(default_factory=ModelSettings)
    remeasure: bool = False
    builder: SceneBuilder | None = None
    conversation: Conversation | None = field(default=None, init=False)
    seen: DetectedScene | None = field(default=None, init=False)
    images: tuple[Path, ...] = field(default=(), init=False)
    _challenged: bool = field(default=False, init=False)

    @property
    def name(self) -> str:
        """Name on the command line."""
        return self.model

    def plan(self, request: str | None, scene: Scene | None, images: Sequence[Path] = ()) -> Plan:
        """The first plan of the model that passes the check.

        Raises:
            InputError: unknown provider or module, unreadable image, neither a scene nor a picture.
            Unavailable: no extra, no key, provider out of reach or refusing, time used up.
            PlanRejected: the model gave no valid plan.
        """
        self._challenged = False
        self.images = tuple(images)
        settings = self.model_settings
        endpoint = Endpoint.of(self.model, settings.base_url)
        prompt = self._prompt(request or "", scene, images)
        pictures = [picture(path) for path in prompt.images]
        shown = tuple(each.note() for each in pictures)
        self.conversation = Conversation(endpoint.name, prompt.system, shown)
        schema = None
        if settings.native:
            schema = flat.flat_schema(vocabulary(), with_scene=scene is None)
        session = Session(endpoint, prompt.system, pictures, schema, settings.budget)
        critic = Critic.of(settings, endpoint, prompt.user, pictures, self.conversation)
        plan = converse(
            self.conversation,
            prompt.user,
            session.ask,
            lambda text: self.judge(text, scene, request),
            settings.rounds,
            settings.budget.exhausted,
            critic or (lambda _: None),
        )
        return replace(
            plan, planner=self.conversation.planner, notes=(*plan.notes, *self._remarks())
        )

    def _remarks(self) -> list[str]:
        """Remarks on a critic that could not be asked."""
        critique = self.conversation.critique if self.conversation is not None else None
        if critique is None or not critique.error:
            return []
        return [f"No critic read the plan: {critique.error}"]

    def judge(
        self, text: str, scene: Scene | None, request: str | None = ""
    ) -> tuple[Plan | None, list[str]]:
        """The plan in an answer and what the check finds wrong with it.

        None as the `request` wants all that the scene leaves out; what any other one means is open.
        """
        try:
            proposal = read_answer(text)
            return proposal.plan, self._findings(proposal, scene, request)
        except InputError as error:
            return None, [str(error)]

    def _prompt(self, request: str, scene: Scene | None, images: Sequence[Path]) -> Prompt:
        symbols = None
        if scene is None:
            symbols = self._names(images)
        told = self.model_settings
        prompt = compose(
            vocabulary(),
            request,
            scene,
            images,
            symbols,
            told.without,
            told.prompt,
            told.comments,
            self.builder.arm if self.builder else None,
        )
        if told.native:
            return replace(prompt, user=f"{prompt.user}\n\n{flat.NOTE}")
        return prompt

    def _names(self, images: Sequence[Path]) -> Symbols:
        """The names there are without a scene."""
        if self.builder is None or not images:
            raise InputError(
                "there is neither a scene nor a picture for the model to look at: give scene=D.xml, or "
                "images=I.png with its camera in poses=poses.yaml"
            )
        _ = self.builder.camera
        return self.builder.symbols

    def _findings(self, proposal: Proposal, scene: Scene | None, request: str | None) -> list[str]:
        from palpate.planning.check.check import check

        plan = proposal.plan
        if plan.tree is not None and scene is None:
            self.seen, scene = self._built(proposal.scene)
        wanted = None
        if plan.tree is not None and scene is not None:
            wanted = self._wanted(request, scene)
        found = check(plan, scene, remeasure=self.remeasure, requested=wanted)
        told = [f"{finding.path}, {finding.rule}: {finding.message}" for finding in found]
        return told or self._challenge(plan, scene, request)

    def _challenge(self, plan: Plan, scene: Scene | None, request: str | None) -> list[str]:
        """Asks once whether a refusal is meant, where what R seems to ask for can be measured."""
        doubtful = plan.tree is None and not self._challenged and scene is not None
        if not doubtful or scene is None or "text" in self.model_settings.without:
            return []
        wanted = requested(request or None, scene, self.remeasure)
        if not wanted:
            return []
        self._challenged = True
        named = ", ".join(str(parameter) for parameter in wanted)
        return [
            f"tree: there is none, yet R seems to ask for {named}, which D leaves out and the robot can "
            "measure; give a tree for what is meant, or return the same answer again if none of it is"
        ]

    def _wanted(self, request: str | None, scene: Scene) -> tuple[Parameter, ...] | None:
        """Parameters that a plan must measure without a request: all that is missing. With a
        request the model decides, and None is returned."""
        if request is not None or "text" in self.model_settings.without:
            return None
        return requested(None, scene, self.remeasure)

    def _built(self, objects: tuple[SceneObject, ...]) -> tuple[DetectedScene, Scene]:
        if self.builder is None:
            raise InputError(
                "there is no simulation description to check the plan against; give one with scene="
            )
        if not objects:
            raise InputError(
                "'scene' is missing: there is no D, so list the objects that the image shows"
            )
        seen = self.builder.detected(objects, self.images)
        return seen, seen.scene()
