"""The front door: a scene, a plan and a run, each with the verbs that lead to the next.

    scene = pp.load("desk.xml")
    plan = scene.plan("how heavy is the mug?")
    run = plan.run(seed=0)

`Scene`, `Plan` and `Run` are the inner classes plus verbs that call the pipeline, so that inner rooms
never import upwards and there is no second scene.
"""

from __future__ import annotations

from palpate.api.at_once import plan_settings, run, run_settings
from palpate.api.dynamics import dynamics
from palpate.api.noise import noise
from palpate.api.plans import Plan
from palpate.api.recordings import estimate
from palpate.api.runs import Fusion, Run, compare, finish, fuse, open
from palpate.api.scenes import Scene, load, load_settings
from palpate.api.seeing import see

__all__ = [
    "Fusion",
    "Plan",
    "Run",
    "Scene",
    "compare",
    "dynamics",
    "estimate",
    "finish",
    "fuse",
    "load",
    "load_settings",
    "noise",
    "open",
    "plan_settings",
    "run",
    "run_settings",
    "see",
]
