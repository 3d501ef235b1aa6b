"""Settings of a run: one immutable model.

`request.json`, the command line's options and their help derive from it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_type_hints

from palpate.common.errors import InputError, unknown_name
from palpate.common.extensions import Option, iter_options
from palpate.common.parameter import Parameter
from palpate.common.version import __version__
from palpate.planning.model.settings import ModelSettings
from palpate.robots.noise_levels import DEFAULT_LEVEL, LEVELS

if TYPE_CHECKING:
    from pydantic import TypeAdapter

    from palpate.estimation.quantities.within import Within
    from palpate.execution.recovery import OnFailure
    from palpate.robots.description import RobotDescription
    from palpate.scene.scene import Scene
else:
    # The types are checked when settings are made: a command's help, which derives from this page,
    # loads neither numpy nor pydantic.
    OnFailure, Within = str, Any


def _widths(given: Any = None) -> Within:
    from palpate.estimation.quantities.within import Within

    return given if isinstance(given, Within) else Within.read(given or {})


def _names(given: Any) -> Any:
    if isinstance(given, str | Parameter):
        return (str(given),)
    listed: Any = () if given is None else given
    return tuple(str(name) for name in listed) if hasattr(listed, "__iter__") else given


WORLD_CAMERA = "world:"  # Prefix of a `camera` that belongs to the simulated world

# Conversions of the forms in which users give a field, before its type is checked.
FORMS: Mapping[str, Callable[[Any], Any]] = {
    "within": _widths,
    "measure": _names,
    "robot_body": _names,
    "images": _names,
    "arm": str,
    "camera": lambda given: str(given) if isinstance(given, int) else given,
}


@dataclass(frozen=True)
class Settings:
    """R, D, I and where to run.

    Every field with an `Option` is an option of the command line, and its help is the field's
    documentation. `request`, `scene` and `images` are the paper's R, D and I.
    """

    request: Annotated[
        str | None,
        Option("What you want to simulate, in your words.", "TEXT", "Scene", ("-r", "--request")),
    ] = None
    scene: Annotated[
        Path | None, Option("Your MJCF; what is absent or '?' is unknown.", "FILE", "Scene")
    ] = None
    images: Annotated[
        tuple[Path, ...],
        Option("Picture of the workspace; may be repeated.", "FILE", "Scene", ("--image",)),
    ] = ()
    poses: Annotated[
        Path | None, Option("poses.yaml: objects, places, offsets.", "FILE", "Scene")
    ] = None
    camera: Annotated[
        str | None,
        Option(
            "Look first, and use the poses seen: picture, video, camera number, realsense, or world:NAME of --world.",
            "SOURCE",
            "Scene",
        ),
    ] = None
    intrinsics: Annotated[
        Path | None, Option("YAML with the camera's lens: fx, fy, cx, cy, size, …", "FILE", "Scene")
    ] = None
    pose_estimator: Annotated[
        str | None,
        Option(
            "A pose estimator to ask in the look: a command, or http://HOST:PORT/PATH.",
            "COMMAND|URL",
            "Scene",
        ),
    ] = None
    root: Annotated[
        Path | None,
        Option(
            "Folder of the scene's files (default: the nearest that holds them all).",
            "DIR",
            "Scene",
        ),
    ] = None
    robot_body: Annotated[
        tuple[str, ...],
        Option(
            "Root body of the scene's own robot, which the arm replaces, or 'none'; may be repeated "
            "(default: found by its actuators or its hand).",
            "NAME",
            "Scene",
        ),
    ] = ()
    arm: Annotated[
        str, Option("Name of an arm, or folder of its description.", "NAME|PATH/", "Scene")
    ] = "fr3"
    planner: Annotated[
        str, Option("symbolic | exhaustive | replay:FILE | PROVIDER:MODEL", "NAME", "Planner")
    ] = "symbolic"
    measure: Annotated[
        tuple[str, ...],
        Option(
            "Parameter to measure, e.g. bottle.mass; bottle.* for all that is missing of it, missing for "
            "everything; comma lists, may be repeated.",
            "OBJECT.QUANTITY",
            "Scene",
            ("-m", "--measure"),
        ),
    ] = ()
    remeasure: Annotated[
        bool, Option("Measure requested quantities even if the scene states them.", None, "Planner")
    ] = False
    within: Annotated[
        Within,
        Option(
            "Half width of the 95 % interval to reach, e.g. mass=1g, com=2mm, friction=0.01, bottle.mass=1g; "
            "may be repeated. Units: kg g mg, m cm mm um, N/m kN/m; SI without one.",
            "QUANTITY=VALUE",
            "Planner",
        ),
    ] = field(default_factory=_widths)
    cautious: Annotated[
        bool, Option("Move slowly everywhere: nothing unseen is hit hard.", None, "Robot")
    ] = False
    robot_config: Annotated[
        Path | None, Option("robot.yaml: calibration of this very arm.", "FILE", "Robot")
    ] = None
    world: Annotated[
        Path | None, Option("MJCF of the embedded robot's hidden world.", "FILE", "Robot")
    ] = None
    robot: Annotated[
        str | None, Option("A real robot instead of the embedded one.", "URL", "Robot")
    ] = None
    noise: Annotated[
        str,
        Option(
            f"Noise model of the robot: {' | '.join(LEVELS)} | FILE.yaml",
            "NAME|FILE",
            "Robot",
            choices=LEVELS,
        ),
    ] = DEFAULT_LEVEL
    seed: Annotated[int, Option("Seed of everything random.", "N", "Robot")] = 0
    rehearse: Annotated[
        bool | None,
        Option(
            "Execute in simulation first (default: for a real robot, and a plan of a model or file).",
            None,
            "Robot",
            ("--rehearse/--no-rehearse",),
        ),
    ] = None
    on_failure: Annotated[
        OnFailure, Option("When a leaf fails: stop | skip | replan.", "POLICY", "Robot")
    ] = "stop"
    out: Annotated[
        Path | None, Option("Run folder to make (default: runs/SCENE-TIME).", "DIR", "Robot")
    ] = None
    twin: Annotated[
        Path | None,
        Option(
            "Also write the twin there, with the includes, meshes and pictures that it needs.",
            "FILE",
            "Robot",
        ),
    ] = None
    fast: Annotated[
        bool,
        Option("No film and no replay of the twin; the measurement stays the same.", None, "Robot"),
    ] = False
    model_settings: ModelSettings = field(default_factory=ModelSettings)

    def __post_init__(self) -> None:
        """Convert the fields to their types. Raises InputError: a value of another type; the
        message names the argument."""
        from pydantic import ValidationError

        # Convert each field by its own adapter; the object is frozen.
        for name, adapter in _adapters().items():
            given = getattr(self, name)
            given = FORMS[name](given) if name in FORMS else given
            try:
                object.__setattr__(self, name, adapter.validate_python(given))
            except ValidationError as error:
                wrong = error.errors()[0]["msg"].replace(
                    "a valid tuple", "a text, or a list of texts"
                )
                options = {field.name: f". {field.option.help}" for field in iter_options(Settings)}
                shown = f"{name}=: {wrong}, not {str(given)[:60]}{options.get(name, '')}"
                raise InputError(shown) from None

    def having(self, **changes: Any) -> Settings:
        """Return these settings with changed fields, converted to their types. Raises InputError:
        an unknown field, or a value of another type."""
        return settings_of(**{f.name: getattr(self, f.name) for f in fields(self)} | changes)

    def check_values(self, at_hand: bool = False) -> Settings:
        """Return these settings after checking them against each other and the file system.

        Args:
            at_hand: the scene is an object and came from no file.

        Raises:
            InputError: nothing is asked, or a value is out of range; the message names the
                argument.
        """
        from palpate.execution.recovery import OnFailure
        from palpate.robots.owner import own_arm
        from palpate.robots.simulated.noise.models import noise_models

        # Something to do: a request, a scene, or a stored plan.
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
        # Each value against its own domain.
        self._check_camera(at_hand)
        noise_models().load(self.noise)
        own_arm(self.arm, self.cautious, self.robot_config)
        self.model_settings.check_values()
        if self.on_failure not in get_args(OnFailure):
            raise unknown_name("policy for failures", self.on_failure, get_args(OnFailure))
        # Values that exclude each other, and files that would be overwritten.
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

    def _check_camera(self, at_hand: bool) -> None:
        if self.camera is None:
            for name in ("intrinsics", "pose_estimator"):
                if getattr(self, name) is not None:
                    raise InputError(f"{name}= goes with camera=SOURCE, a look before the run")
            return
        if self.scene is None and not at_hand:
            raise InputError("camera= looks for the objects of a scene: give scene=D.xml")
        if self.camera.startswith(WORLD_CAMERA) and self.robot is not None:
            raise InputError(
                f"camera={self.camera} is a camera of the simulated world, and robot= a real one: give its camera"
            )

    def described_arm(self) -> RobotDescription:
        """Load the arm with the knowledge of its owner, calibration included.

        A real arm has its description and stiffness, the embedded one the datasheet of its noise
        model. Raises InputError: no such arm or noise model, or its robot.yaml cannot be used.
        """
        from palpate.robots.owner import load_description, own_arm
        from palpate.robots.simulated.noise.models import noise_models

        datasheet = None
        if self.robot is None:
            arm = load_description(self.arm, self.cautious)
            datasheet = noise_models().load(self.noise, arm).datasheet
        real = self.robot is not None
        return own_arm(self.arm, self.cautious, self.robot_config, datasheet, real)

    def read_scene(self, arm: RobotDescription) -> Scene:
        """Read the scene with its poses, for an arm."""
        from palpate.scene.load import load_scene

        assert self.scene is not None
        return load_scene(self.scene, self.poses, arm, root=self.root, robot_body=self.robot_body)


def settings_of(**given: Any) -> Settings:
    """Return the settings with these fields, converted to their types. Raises InputError: an
    unknown field, or a value of another type."""
    names = [field.name for field in fields(Settings)]
    for name in given:
        if name not in names:
            raise unknown_name("argument", name, names)
    return Settings(**given)


@cache
def _adapters() -> Mapping[str, TypeAdapter[Any]]:
    """Make pydantic's check of each field."""
    from pydantic import TypeAdapter

    hints = get_type_hints(Settings, include_extras=True)
    return {field.name: TypeAdapter[Any](hints[field.name]) for field in fields(Settings)}


def _check_request(request: str) -> None:
    from palpate.planning.planner import MAX_REQUEST

    if not request.strip():
        raise InputError(
            "the request is empty: say what you want to simulate, e.g. 'the mass of the bottle'"
        )
    if len(request) > MAX_REQUEST:
        raise InputError(
            f"the request has {len(request)} characters, at most {MAX_REQUEST} are read: "
            "say it in a sentence or two"
        )


@dataclass(frozen=True)
class References:
    """References and procedures of a calibration, as given by the user."""

    weight: Annotated[str | None, Option("Known mass: 0.5kg±0.1g", "[OBJECT=]MASS")] = None
    gauge: Annotated[str | None, Option("Known height: 50mm±0.01mm", "[SURFACE=]HEIGHT")] = None
    own_weight: Annotated[bool, Option("Let the arm weigh itself.")] = False
    camera: Annotated[
        str | None,
        Option(
            "Camera that looks at the arm, or is on its hand: number, realsense, or world:NAME.",
            "SOURCE",
        ),
    ] = None
    intrinsics: Annotated[
        Path | None, Option("YAML with its lens, and roughly where it is.", "FILE")
    ] = None
    tag: Annotated[
        str | None,
        Option("Tag on the hand, or before a camera on it: 0=100mm±0.1mm", "[NUMBER=]SIDE"),
    ] = None
    plot: Annotated[
        Path | None, Option("Picture of the camera's residuals to write.", "FILE.png")
    ] = None


# Fields that `request.json` states as absolute paths: the run folder may be read from elsewhere.
PATHS = ("scene", "root", "poses", "images", "intrinsics", "world", "robot_config", "twin")


def request_json(settings: Settings) -> dict[str, Any]:
    """Make the content of `request.json`, which suffices to repeat the run."""
    from pydantic import TypeAdapter

    # Make all paths absolute.
    absolute: dict[str, Any] = {"noise": noise_source(settings.noise)}
    if settings.camera is not None and Path(settings.camera).is_file():
        absolute["camera"] = str(Path(settings.camera).absolute())
    for name in PATHS:
        value = getattr(settings, name)
        if isinstance(value, Path):
            absolute[name] = value.absolute()
        elif value:
            absolute[name] = tuple(path.absolute() for path in value)
    # Dump the fields that define the run; `out` is only its place.
    stated = replace(settings, **absolute)
    document = TypeAdapter(Settings).dump_python(stated, mode="json", exclude={"out", "within"})
    document["within"] = dict(settings.within)
    model = settings.model_settings
    asking = document.pop("model_settings")
    asking |= {"base_url": model.address, "without": sorted(model.without)}
    return document | {"asking": asking, "palpate": __version__}


def settings_from(document: Mapping[str, Any]) -> Settings:
    """Make the settings from a document of `request_json`. Absent fields have their defaults.
    Raises InputError: it is not such a document."""
    known = {field.name for field in fields(Settings)}
    given = {name: value for name, value in document.items() if name in known}
    return settings_of(**given, model_settings=document.get("asking", {}))


def noise_source(noise: str) -> str:
    """Return the name of a noise model, or the absolute path of its file."""
    from palpate.robots.simulated.noise.models import means_file

    return str(Path(noise).absolute()) if means_file(noise) else noise
