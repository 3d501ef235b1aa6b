"""Planner with a vision-language model of any provider.

Keys come from the environment and are redacted from every message. Only text and statistics are
recorded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from palpate.common.errors import InputError
from palpate.common.parameter import Parameter
from palpate.planning.model import normal
from palpate.planning.model.answer import Proposal, read_answer
from palpate.planning.model.conversation import Conversation
from palpate.planning.model.prompt import Prompt, compose
from palpate.planning.model.provider import Endpoint
from palpate.planning.model.rounds import converse, critic_endpoint, objection_to
from palpate.planning.model.session import ModelSession, picture
from palpate.planning.model.settings import ModelSettings
from palpate.planning.plan import Plan
from palpate.planning.planner import Rehearse
from palpate.planning.symbolic.planner import (
    assemble,
    requested_parameters,
    split_known,
    stated_clause,
    surely_requested_parameters,
)
from palpate.primitives.registry import vocabulary
from palpate.scene.detections import SceneObject
from palpate.scene.picture_scene import DetectedScene, SceneBuilder

if TYPE_CHECKING:
    from palpate.scene.scene import Scene


@dataclass(slots=True)
class VlmPlanner:
    """Planner with a model.

    Attributes:
        model: `PROVIDER:MODEL`, or `PROVIDER` alone for its default.
        model_settings: address, form, feedback and budget.
        remeasure: requested values are measured even where the scene states them.
        builder: makes a scene of the detected objects, for a request without a scene.
        measure: the exact set of parameters of the plan; None to let the model decide.
        rehearse: executes a plan in physics after the check; its finding goes back to the model.
        conversation: the latest dialogue, also after an error in `plan`.
        seen: the detected scene, if there was no scene.
        images: the pictures, which refine the detected scene.
    """

    looks: ClassVar[bool] = True

    model: str
    model_settings: ModelSettings = field(default_factory=ModelSettings)
    remeasure: bool = False
    builder: SceneBuilder | None = None
    measure: tuple[Parameter, ...] | None = None
    rehearse: Rehearse | None = None
    conversation: Conversation | None = field(default=None, init=False)
    seen: DetectedScene | None = field(default=None, init=False)
    images: tuple[Path, ...] = field(default=(), init=False)

    @property
    def name(self) -> str:
        """Name on the command line."""
        return self.model

    def plan(self, request: str | None, scene: Scene | None, images: Sequence[Path] = ()) -> Plan:
        """Return the model's first plan that passes the check.

        Raises:
            InputError: unknown provider or module, unreadable image, neither a scene nor a picture.
            Unavailable: missing SDK or key, unreachable or refusing provider, time used up.
            PlanRejected: the model gave no valid plan.
        """
        self.images = tuple(images)
        settings = self.model_settings
        # Compose prompt and pictures, and record them as sent.
        endpoint = Endpoint.of(self.model, settings.base_url)
        prompt = self._prompt(request or "", scene, images)
        pictures = [picture(path) for path in prompt.images]
        shown = tuple(each.note() for each in pictures)
        self.conversation = Conversation(endpoint.name, prompt.system, shown)
        schema = None  # JSON in prose, for every provider
        if settings.native:
            schema = normal.flat_schema(vocabulary(), with_scene=scene is None)
        # Start the session, and find the critic's endpoint before the first request.
        session = ModelSession(endpoint, prompt.system, pictures, schema, settings.budget)
        conversation, critic = self.conversation, critic_endpoint(settings, endpoint)

        def objection(plan: Plan) -> str | None:
            return critic and objection_to(plan, critic, prompt.task, session, conversation)

        def question(plan: Plan) -> str | None:
            return self.question(plan, scene, request) if settings.rounds else None

        plan = converse(
            conversation,
            prompt.user,
            session.ask,
            lambda text: self.judge(text, scene, request),
            rounds=settings.rounds,
            may_go_on=settings.budget.exhaustion_reason,
            critic=objection,
            question=question,
        )
        # Note repeated measurements and a failed critic.
        notes, critique = (*plan.notes, *notes_on_known_values(plan, scene)), conversation.critique
        if critique is not None and critique.error:
            notes = (*notes, f"No critic read the plan: {critique.error}")
        return replace(plan, planner=conversation.planner, notes=notes)

    def _prompt(self, request: str, scene: Scene | None, images: Sequence[Path]) -> Prompt:
        # Without a scene, the poses come from the builder of detected objects.
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
            remeasure=self.remeasure,
        )
        if settings.native:
            return replace(prompt, order=f"{prompt.order}\n\n{normal.NOTE}")
        return prompt

    def judge(
        self, text: str, scene: Scene | None, request: str | None = ""
    ) -> tuple[Plan | None, list[str]]:
        """Return the plan in an answer, and the findings on it.

        Without a `request` (None) the plan must measure all missing parameters of the scene. With a
        request, the model decides on the parameters.
        """
        try:
            # An unreadable answer is a finding, so the model can correct it.
            proposal = read_answer(text)
            return proposal.plan, self._findings(proposal, scene, request)
        except InputError as error:
            return None, [str(error)]

    def _findings(self, proposal: Proposal, scene: Scene | None, request: str | None) -> list[str]:
        from palpate.planning.check.check import check
        from palpate.planning.check.finding import digest

        plan, wanted = proposal.plan, None
        if plan.tree is not None:
            if scene is None:
                scene = self._detect(proposal.scene)
            # Without a request, or with exact parameters, the set is fixed.
            reads_request = "text" not in self.model_settings.without
            if self.measure is not None or (request is None and reads_request):
                wanted = requested_parameters(None, scene, self.remeasure, self.measure)
        # Rehearse in physics only a plan that passes the check.
        faults = check(plan, scene, remeasure=self.remeasure, requested=wanted)
        if not faults and plan.tree is not None and scene is not None and self.rehearse is not None:
            harm = self.rehearse(plan, scene)
            faults = () if harm is None else (harm,)
        return digest(faults)

    def question(self, plan: Plan, scene: Scene | None, request: str | None) -> str | None:
        """Return a question about a plan that lacks parameters requested by the grammar's reading.

        This includes a plan without a tree. None if the readings agree, or the grammar's reading is
        uncertain.
        """
        if scene is None or "text" in self.model_settings.without:
            return None
        read = (
            surely_requested_parameters(request or None, scene, self.remeasure, self.measure) or ()
        )
        # Compare by known quantity, because several quantities may state the same value.
        quantities = scene.catalogue
        has = {(item.object, quantities[item.quantity].known_as()) for item in plan.parameters}
        lacking = [p for p in read if (p.object, quantities[p.quantity].known_as()) not in has]
        if not lacking or assemble(scene, lacking).failed:
            return None
        # State if the scene already has the value.
        named = ", ".join(str(parameter) for parameter in lacking)
        unknown, known = "D leaves it open", "it is to be measured though D states it"
        state = known if set(lacking) <= set(split_known(lacking, scene, False)[0]) else unknown
        # A plan with a tree lacks some parameters; one without a tree lacks all.
        if plan.tree is not None:
            return (
                f"R can be read as asking for {named}, too, which Φ lacks; {state}. Does R ask for it? If so, add "
                "it and what measures it; if not, or if something stands against it, keep your answer."
            )
        return (
            f"R can be read as asking for {named}; {state}, and by D alone the robot can measure it. Does R "
            "mean that, and does nothing that you see or know stand against it? If so, give a tree; if not, "
            "keep your answer."
        )

    def _detect(self, objects: tuple[SceneObject, ...]) -> Scene:
        """Return the scene of the detected objects, stored in `seen`."""
        if self.builder is None:
            raise InputError(
                "there is no simulation description to check the plan against; give one with scene="
            )
        if not objects:
            raise InputError(
                "'scene' is missing: there is no D, so list the objects that the image shows"
            )
        self.seen = self.builder.from_detections(objects, self.images)
        return self.seen.scene()


def notes_on_known_values(plan: Plan, scene: Scene | None) -> tuple[str, ...]:
    """Notes on the plan's parameters that the scene states."""
    if scene is None:
        return ()
    known, _ = split_known(plan.parameters, scene, False)
    return tuple(f"{stated_clause(parameter, scene)}, and measured again." for parameter in known)
