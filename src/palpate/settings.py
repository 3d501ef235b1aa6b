"""What the user hands over: one frozen description of a run."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, get_args

from palpate.errors import InputError, unknown_name
from palpate.execution.recovery import OnFailure
from palpate.planning.model.session import ModelSettings
from palpate.planning.planner import MAX_REQUEST

Noise = Literal["none", "lab", "datasheet"]


@dataclass(frozen=True, slots=True)
class Job:
    """R, D, I and where to run.

    Attributes:
        request: R, the sentence, or None.
        scene: D, an MJCF file, or None.
        poses: poses.yaml. images: I, picture files.
        world: MJCF of the hidden simulated world; None simulates D with its unknowns drawn from
            priors.
        robot: URL of a real robot; None is the embedded one.
        planner: `symbolic`, `exhaustive`, `replay:FILE` or `PROVIDER:MODEL`.
        noise: sensor world of the embedded robot. seed: of everything random in it.
        out: run folder to make; must not exist.
        remeasure: measure what R asks even if D states it.
        on_failure: what to do when the tree fails (see `palpate.recovery`).
        asking: how a model is asked, where the planner is one.
        rehearse: execute the plan in simulation first; None means only before a real robot moves.
    """

    request: str | None = None
    scene: Path | None = None
    poses: Path | None = None
    images: tuple[Path, ...] = ()
    world: Path | None = None
    robot: str | None = None
    planner: str = "symbolic"
    noise: Noise = "lab"
    seed: int = 0
    out: Path | None = None
    remeasure: bool = False
    on_failure: OnFailure = "stop"
    rehearse: bool | None = None
    model_settings: ModelSettings = field(default_factory=ModelSettings)

    def checked(self) -> Job:
        """This job, once nothing is found wrong with it.

        Raises:
            InputError: nothing asked, or a value out of range.
        """
        if self.request is None and self.scene is None and not self.planner.startswith("replay:"):
            raise InputError(
                "nothing to do: give a request (-r TEXT), a scene (--scene D.xml), or both"
            )
        if self.request is not None and not self.request.strip():
            raise InputError(
                "the request is empty: say what you want to simulate, e.g. -r 'the mass of the bottle'"
            )
        if self.request is not None and len(self.request) > MAX_REQUEST:
            raise InputError(
                f"the request has {len(self.request)} characters, at most {MAX_REQUEST} are read: "
                "say it in a sentence or two"
            )
        if self.noise not in get_args(Noise):
            raise unknown_name("noise", self.noise, get_args(Noise))
        if self.on_failure not in get_args(OnFailure):
            raise unknown_name("policy for failures", self.on_failure, get_args(OnFailure))
        if self.world is not None and self.robot is not None:
            raise InputError("--world and --robot exclude each other: a run is simulated or real")
        if self.seed < 0:
            raise InputError(f"--seed must not be negative, not {self.seed}")
        if self.out is not None and self.out.exists():
            raise InputError(
                f"'{self.out}' exists already: choose another --out, nothing is overwritten"
            )
        return self
