"""Settings of a run, immutable, and their form in `request.json`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args
from urllib.parse import urlsplit, urlunsplit

from palpate import __version__
from palpate.errors import InputError, unknown_name
from palpate.execution.recovery import OnFailure
from palpate.planning.model.settings import Budget, ModelSettings
from palpate.planning.planner import MAX_REQUEST
from palpate.quantities.within import Within
from palpate.robots.registry import DEFAULT, load_description

if TYPE_CHECKING:
    from palpate.robots.description import RobotDescription


@dataclass(frozen=True, slots=True)
class Settings:
    """R, D, I and where to run.

    Attributes:
        request: R, the sentence, or None.
        scene: D, an MJCF file, or None.
        root: folder outside of which none of the scene's files is read; None: see
            `mjcf.reading.read_document`.
        robot_body: bodies that the scene's own robots begin with, which the arm takes the place of;
            `none`: it has none. Left empty, they are recognized (`mjcf.roles.robots`).
        poses: poses.yaml.
        images: I, picture files.
        world: MJCF of the hidden simulated world; None simulates D with its unknowns drawn from
            priors.
        robot: URL of a real robot; None is the embedded one.
        arm: the arm's description, by name or folder.
        cautious: it moves slowly everywhere.
        robot_config: robot.yaml, what was measured of this very arm.
        planner: `symbolic`, `exhaustive`, `replay:FILE` or `PROVIDER:MODEL`.
        noise: noise model of the embedded robot, by name or file.
        seed: of everything random in it.
        out: run folder to make; must not exist.
        twin: where the twin is written besides, with the files that it needs there; must not exist.
        remeasure: measure what R asks even if D states it.
        on_failure: what to do when the tree fails (see `palpate.execution.recovery`).
        rehearse: execute the plan in simulation first; None means only before a real robot moves.
        within: how narrow intervals are to be: what is wider is measured again.
        fast: leave out what takes longest and measures nothing, film and replay.
        model_settings: how a model is asked, where the planner is one.
    """

    request: str | None = None
    scene: Path | None = None
    root: Path | None = None
    robot_body: tuple[str, ...] = ()
    poses: Path | None = None
    images: tuple[Path, ...] = ()
    world: Path | None = None
    robot: str | None = None
    arm: str = DEFAULT
    cautious: bool = False
    robot_config: Path | None = None
    planner: str = "symbolic"
    noise: str = "lab"
    seed: int = 0
    out: Path | None = None
    twin: Path | None = None
    remeasure: bool = False
    on_failure: OnFailure = "stop"
    rehearse: bool | None = None
    within: Within = field(default_factory=Within)
    fast: bool = False
    model_settings: ModelSettings = field(default_factory=ModelSettings)

    def checked(self, at_hand: bool = False) -> Settings:
        """These settings, once nothing is found wrong with them; `at_hand`: there is a scene that
        came from no file.

        Raises:
            InputError: nothing asked, or a value out of range; the message names the argument.
        """
        from palpate.robots.owner.registered import own_arm
        from palpate.robots.simulated.noise.models import noise_models

        replayed = self.planner.startswith("replay:")
        if self.request is None and self.scene is None and not at_hand and not replayed:
            raise InputError(
                "nothing to do: give a request (request=TEXT), a scene (scene=D.xml), or both"
            )
        if self.request is not None:
            _check_request(self.request)
        if self.root is not None and not self.root.is_dir():
            raise InputError(
                f"'{self.root}' is no folder: give root= the one the scene's files lie in"
            )
        noise_models().check(self.noise)
        own_arm(self.arm, self.cautious, self.robot_config)
        if self.on_failure not in get_args(OnFailure):
            raise unknown_name("policy for failures", self.on_failure, get_args(OnFailure))
        if self.world is not None and self.robot is not None:
            raise InputError("world= and robot= exclude each other: a run is simulated or real")
        if self.seed < 0:
            raise InputError(f"seed= must not be negative, not {self.seed}")
        if self.out is not None and self.out.exists():
            raise InputError(
                f"'{self.out}' exists already: choose another out=, nothing is overwritten"
            )
        if self.twin is not None and self.twin.exists():
            raise InputError(f"'{self.twin}' exists already: choose another twin=")
        return self

    def described_arm(self) -> RobotDescription:
        """The arm as its owner knows it: its description, with a real one's springs, of the embedded
        one what the noise model's datasheet says, and what was measured of it.

        Raises:
            InputError: no such arm or noise model, or its robot.yaml cannot be used.
        """
        from palpate.robots.owner.registered import own_arm
        from palpate.robots.simulated.noise.models import noise_models

        told = None
        if self.robot is None:
            arm = load_description(self.arm, self.cautious)
            told = noise_models().load(self.noise, arm).datasheet
        real = self.robot is not None
        return own_arm(self.arm, self.cautious, self.robot_config, told, real)


def _check_request(request: str) -> None:
    if not request.strip():
        raise InputError(
            "the request is empty: say what you want to simulate, e.g. 'the mass of the bottle'"
        )
    if len(request) > MAX_REQUEST:
        raise InputError(
            f"the request has {len(request)} characters, at most {MAX_REQUEST} are read: "
            "say it in a sentence or two"
        )


def request_json(settings: Settings) -> dict[str, Any]:
    """The content of `request.json`: what was asked, enough to run it again."""

    def shown(path: Path | None) -> str | None:
        return str(path.absolute()) if path else None

    return {
        "request": settings.request,
        "scene": shown(settings.scene),
        "root": shown(settings.root),
        "robot_body": list(settings.robot_body),
        "poses": shown(settings.poses),
        "images": [shown(path) for path in settings.images],
        "world": shown(settings.world),
        "robot": settings.robot,
        "arm": settings.arm,
        "cautious": settings.cautious,
        "robot_config": shown(settings.robot_config),
        "planner": settings.planner,
        "noise": noise_told(settings.noise),
        "seed": settings.seed,
        "twin": shown(settings.twin),
        "remeasure": settings.remeasure,
        "on_failure": settings.on_failure,
        "rehearse": settings.rehearse,
        "within": dict(settings.within),
        "fast": settings.fast,
        "asking": _model_settings_json(settings.model_settings),
        "palpate": __version__,
    }


def noise_told(noise: str) -> str:
    """Name of a noise model in files: its own, or the path of its file."""
    from palpate.robots.simulated.noise.models import means_file

    return str(Path(noise).absolute()) if means_file(noise) else noise


def settings_from(document: Mapping[str, Any]) -> Settings:
    """The settings that `request_json` wrote; what the document leaves out has its default.

    Raises:
        InputError: it is not such a document.
    """

    def path(name: str) -> Path | None:
        value = document.get(name)
        return Path(value) if value else None

    plain = (
        "request",
        "robot",
        "arm",
        "cautious",
        "planner",
        "noise",
        "seed",
        "remeasure",
        "on_failure",
        "fast",
    )
    given = {name: document[name] for name in (*plain, "rehearse") if name in document}
    try:
        return Settings(
            **given,
            scene=path("scene"),
            root=path("root"),
            robot_body=tuple(document.get("robot_body", ())),
            poses=path("poses"),
            twin=path("twin"),
            world=path("world"),
            robot_config=path("robot_config"),
            images=tuple(Path(image) for image in document.get("images", ())),
            within=Within.read(document.get("within", {})),
            model_settings=_model_settings_from(document.get("asking", {})),
        )
    except (TypeError, ValueError) as error:
        raise InputError(f"request.json is not one that palpate wrote: {error}") from None


def _model_settings_json(model_settings: ModelSettings) -> dict[str, Any]:
    """Model settings as JSON; of the address, without any credentials in it."""
    url = urlsplit(model_settings.base_url or "")
    host = url.netloc.rpartition("@")[2]
    return asdict(model_settings) | {
        "without": sorted(model_settings.without),
        "base_url": urlunsplit((url.scheme, host, url.path, "", "")) or None,
    }


def _model_settings_from(document: Mapping[str, Any]) -> ModelSettings:
    fields = dict(document)
    budget = Budget(**fields.pop("budget", {}))
    without = frozenset(fields.pop("without", ()))
    return ModelSettings(**fields, without=without, budget=budget)
