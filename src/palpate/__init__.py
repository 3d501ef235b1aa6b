"""palpate: physics-accurate digital twins by touch.

    import palpate as pp

    run = pp.run("desk.xml", "how heavy is the mug?", seed=0)
    run["mug.mass"]

Everything public is listed in `__all__` and loaded when first used, so that `import palpate` costs
nothing.

- `run` does all at once; `load` reads a scene, `Scene.plan` a plan for it, `Plan.run` executes it;
  `open` reads a finished `Run` back from its folder, `fuse` makes one `Fusion` of several,
  `compare` says how far they are apart.
- `see` finds objects by tags in a camera's picture, and makes their poses.
- `estimate` reads a recording of an arm, and tells what it carried; `dynamics` identifies its friction,
  links and hand, `noise` the errors of its signals.
- `Estimate`, `Parameter`, `Trace` and `Twin` are what a run is made of.
- `Cell`, `SimulatedCell`, `Planner`, `Primitive`, `Quantity`, `RobotDescription` and `Vocabulary` are
  where your own parts go in.
- `PalpateError` is the base of all errors raised on purpose: `InputError`, `PlanRejected`,
  `ExecutionAborted`, `Unavailable`.
"""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:
    from palpate.common.errors import ExecutionAborted as ExecutionAborted
    from palpate.common.errors import InputError as InputError
    from palpate.common.errors import PalpateError as PalpateError
    from palpate.common.errors import Unavailable as Unavailable
    from palpate.common.parameter import Parameter as Parameter
    from palpate.common.parameter import PlanRejected as PlanRejected
    from palpate.common.version import __version__ as __version__
    from palpate.estimation.estimate import Estimate as Estimate
    from palpate.estimation.quantities.quantity import Quantity as Quantity
    from palpate.execution.cell import Cell as Cell
    from palpate.execution.simulated_cell import SimulatedCell as SimulatedCell
    from palpate.planning.planner import Planner as Planner
    from palpate.primitives.base import Primitive as Primitive
    from palpate.primitives.registry import Vocabulary as Vocabulary
    from palpate.robots.description import RobotDescription as RobotDescription
    from palpate.runs.api import Plan as Plan
    from palpate.runs.api import Scene as Scene
    from palpate.runs.api import load as load
    from palpate.runs.api import run as run
    from palpate.runs.fuse import Fusion as Fusion
    from palpate.runs.recordings import dynamics as dynamics
    from palpate.runs.recordings import estimate as estimate
    from palpate.runs.recordings import noise as noise
    from palpate.runs.recordings import see as see
    from palpate.runs.stored import Run as Run
    from palpate.runs.stored import compare as compare
    from palpate.runs.stored import fuse as fuse
    from palpate.runs.stored import open as open
    from palpate.trace.samples import Trace as Trace
    from palpate.twin.twin import Twin as Twin


__all__ = [
    "Cell",
    "Estimate",
    "ExecutionAborted",
    "Fusion",
    "InputError",
    "PalpateError",
    "Parameter",
    "Plan",
    "PlanRejected",
    "Planner",
    "Primitive",
    "Quantity",
    "RobotDescription",
    "Run",
    "Scene",
    "SimulatedCell",
    "Trace",
    "Twin",
    "Unavailable",
    "Vocabulary",
    "compare",
    "dynamics",
    "estimate",
    "fuse",
    "load",
    "noise",
    "open",
    "run",
    "see",
]

_HOMES = {
    "__version__": "common.version",
    "Cell": "execution.cell",
    "Estimate": "estimation.estimate",
    "ExecutionAborted": "common.errors",
    "Fusion": "runs.fuse",
    "InputError": "common.errors",
    "PalpateError": "common.errors",
    "Parameter": "common.parameter",
    "Plan": "runs.api",
    "PlanRejected": "common.parameter",
    "Planner": "planning.planner",
    "Primitive": "primitives.base",
    "Quantity": "estimation.quantities.quantity",
    "RobotDescription": "robots.description",
    "Run": "runs.stored",
    "Scene": "runs.api",
    "SimulatedCell": "execution.simulated_cell",
    "Trace": "trace.samples",
    "Twin": "twin.twin",
    "Unavailable": "common.errors",
    "Vocabulary": "primitives.registry",
    "compare": "runs.stored",
    "dynamics": "runs.recordings",
    "estimate": "runs.recordings",
    "fuse": "runs.stored",
    "load": "runs.api",
    "noise": "runs.recordings",
    "open": "runs.stored",
    "run": "runs.api",
    "see": "runs.recordings",
}
"""The module that defines each public name."""


def __getattr__(name: str) -> object:
    """A public name, loaded when first used."""
    if name not in _HOMES:
        raise AttributeError(f"palpate has no '{name}'; it has {', '.join(__all__)}")
    from importlib import import_module

    found = getattr(import_module(f"palpate.{_HOMES[name]}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
