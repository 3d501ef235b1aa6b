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
    from palpate.api.at_once import run as run
    from palpate.api.dynamics import dynamics as dynamics
    from palpate.api.noise import noise as noise
    from palpate.api.plans import Plan as Plan
    from palpate.api.recordings import estimate as estimate
    from palpate.api.runs import Fusion as Fusion
    from palpate.api.runs import Run as Run
    from palpate.api.runs import compare as compare
    from palpate.api.runs import fuse as fuse
    from palpate.api.runs import open as open
    from palpate.api.scenes import Scene as Scene
    from palpate.api.scenes import load as load
    from palpate.api.seeing import see as see
    from palpate.cells.cell import Cell as Cell
    from palpate.cells.simulated import SimulatedCell as SimulatedCell
    from palpate.errors import ExecutionAborted as ExecutionAborted
    from palpate.errors import InputError as InputError
    from palpate.errors import PalpateError as PalpateError
    from palpate.errors import PlanRejected as PlanRejected
    from palpate.errors import Unavailable as Unavailable
    from palpate.estimation.estimate import Estimate as Estimate
    from palpate.parameter import Parameter as Parameter
    from palpate.planning.planner import Planner as Planner
    from palpate.quantities.quantity import Quantity as Quantity
    from palpate.robots.description import RobotDescription as RobotDescription
    from palpate.trace.samples import Trace as Trace
    from palpate.twin.twin import Twin as Twin
    from palpate.vocabulary.base import Primitive as Primitive
    from palpate.vocabulary.registry import Vocabulary as Vocabulary

__version__ = "0.1.0"

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
    "Cell": "cells.cell",
    "Estimate": "estimation.estimate",
    "ExecutionAborted": "errors",
    "Fusion": "api.runs",
    "InputError": "errors",
    "PalpateError": "errors",
    "Parameter": "parameter",
    "Plan": "api.plans",
    "PlanRejected": "errors",
    "Planner": "planning.planner",
    "Primitive": "vocabulary.base",
    "Quantity": "quantities.quantity",
    "RobotDescription": "robots.description",
    "Run": "api.runs",
    "Scene": "api.scenes",
    "SimulatedCell": "cells.simulated",
    "Trace": "trace.samples",
    "Twin": "twin.twin",
    "Unavailable": "errors",
    "Vocabulary": "vocabulary.registry",
    "compare": "api.runs",
    "dynamics": "api.dynamics",
    "estimate": "api.recordings",
    "fuse": "api.runs",
    "load": "api.scenes",
    "noise": "api.noise",
    "open": "api.runs",
    "run": "api.at_once",
    "see": "api.seeing",
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
