"""Vision-language model of any provider as a planner.

Keys come from the environment and are redacted from every message; only words and figures are recorded.
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
from palpate.planning.model.conversation import Conversation
from palpate.planning.model.critic import critic_endpoint, objection_to
from palpate.planning.model.prompt.compose import Prompt, compose
from palpate.planning.model.provider import Endpoint
from palpate.planning.model.rounds import converse
from palpate.planning.model.session import Session, picture
from palpate.planning.model.settings import ModelSettings
from palpate.planning.plan import Plan
from palpate.planning.symbolic.planner import requested
from palpate.scene.pictured.detected import DetectedScene, SceneBuilder
from palpate.scene.pictured.objects import SceneObject
from palpate.vocabulary.registry import vocabulary

if TYPE_CHECKING:
    from palpate.scene.scene import Scene


@dataclass(slots=True)
class VlmPlanner:
    """Model as a planner.

    Attributes:
        model: `PROVIDER:MODEL`, or `PROVIDER` alone for its default.
        model_settings: address, form, feedback and budget.
        remeasure: the request is measured even where the scene states it.
        builder: makes a scene of the detected objects, for a request without a scene.
        measure: the parameters of the plan; None: the model decides by the request.
        conversation: the latest dialogue, also when `plan` raised.
        seen: the detected scene, when there was no scene.
        images: the pictures, which refine the detected scene.
    """

    looks: ClassVar[bool] = True

    model: str
    model_settings: ModelSettings = field(default_factory=ModelSettings)
    remeasure: bool = False
    builder: SceneBuilder | None = None
    measure: tuple[Parameter, ...] | None = None
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
        schema = None  # JSON in prose, which every provider can write
        if settings.native:
            schema = flat.flat_schema(vocabulary(), with_scene=scene is None)
        session = Session(endpoint, prompt.system, pictures, schema, settings.budget)
        # A critic without a key is refused before the first request.
        conversation, critic = self.conversation, critic_endpoint(settings, endpoint)

        def objection(plan: Plan) -> str | None:
            return critic and objection_to(plan, critic, prompt.user, session, conversation)

        plan = converse(
            conversation,
            prompt.user,
            session.ask,
            lambda text: self.judge(text, scene, request),
            rounds=settings.rounds,
            may_go_on=settings.budget.exhausted,
            critic=objection,
        )
        notes, critique = plan.notes, conversation.critique
        if critique is not None and critique.error:
            notes = (*notes, f"No critic read the plan: {critique.error}")
        return replace(plan, planner=conversation.planner, notes=notes)

    def _prompt(self, request: str, scene: Scene | None, images: Sequence[Path]) -> Prompt:
        symbols = None
        if scene is None:
            if self.builder is None or not images:
                raise InputError(
                    "there is neither a scene nor a picture for the model to look at: give scene=D.xml, or "
                    "images=I.png with its camera in poses=poses.yaml"
                )
            _ = self.builder.camera  # raises InputError without one
            symbols = self.builder.symbols
        settings = self.model_settings
        prompt = compose(
            vocabulary(),
            request,
            scene,
            images,
            symbols=symbols,
            without=settings.without,
            style=settings.prompt,
            comments=settings.comments,
            arm=self.builder.arm if self.builder else None,
        )
        if settings.native:
            return replace(prompt, user=f"{prompt.user}\n\n{flat.NOTE}")
        return prompt

    def judge(
        self, text: str, scene: Scene | None, request: str | None = ""
    ) -> tuple[Plan | None, list[str]]:
        """The plan in an answer, and the findings on it.

        Without a `request` (None) the plan must measure all that the scene misses; with one, the
        parameters are the model's decision.
        """
        try:
            proposal = read_answer(text)
            return proposal.plan, self._findings(proposal, scene, request)
        except InputError as error:
            return None, [str(error)]

    def _findings(self, proposal: Proposal, scene: Scene | None, request: str | None) -> list[str]:
        from palpate.planning.check.check import check

        plan, wanted = proposal.plan, None
        reads_request = "text" not in self.model_settings.without
        if plan.tree is not None:
            if scene is None:
                scene = self._detect(proposal.scene)
            if self.measure is not None or (request is None and reads_request):
                wanted = requested(None, scene, self.remeasure, self.measure)
        found = check(plan, scene, remeasure=self.remeasure, requested=wanted)
        if found:
            return [f"{finding.path}, {finding.rule}: {finding.message}" for finding in found]
        # A rejection is questioned once, where the grammar reads from the request what can be measured.
        if plan.tree is not None or self._challenged or scene is None or not reads_request:
            return []
        wanted = requested(request or None, scene, self.remeasure, self.measure)
        if not wanted:
            return []
        self._challenged = True
        named = ", ".join(str(parameter) for parameter in wanted)
        return [
            f"tree: there is none, yet R seems to ask for {named}, which D leaves out and the robot can "
            "measure; give a tree for what is meant, or return the same answer again if none of it is"
        ]

    def _detect(self, objects: tuple[SceneObject, ...]) -> Scene:
        """The scene of the detected objects, which `seen` keeps."""
        if self.builder is None:
            raise InputError(
                "there is no simulation description to check the plan against; give one with scene="
            )
        if not objects:
            raise InputError(
                "'scene' is missing: there is no D, so list the objects that the image shows"
            )
        self.seen = self.builder.detected(objects, self.images)
        return self.seen.scene()
