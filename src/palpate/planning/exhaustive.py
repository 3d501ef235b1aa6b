"""The paper's baseline: probe every surface, weigh and slide every object, whatever is asked or
known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from palpate.parameter import Parameter
from palpate.planning.plan import Plan
from palpate.planning.planner import needs_scene
from palpate.planning.symbolic.planner import assemble
from palpate.scene.scene import Scene

SUITE = {"surface": ("height",), "object": ("mass", "friction")}
"""Quantities that are measured of everything, by role: the paper's "probe heights, weigh, and test
friction"."""


@dataclass(frozen=True, slots=True)
class ExhaustivePlanner:
    """Task-agnostic identification of every surface and object."""

    name: str = "exhaustive"

    def plan(self, request: str | None, scene: Scene | None, images: Sequence[Path] = ()) -> Plan:
        """The full suite of sensing on everything; the request and what is known are not looked at.

        Raises:
            InputError: no scene.
            PlanRejected: nothing in the scene can be measured.
        """
        if scene is None:
            raise needs_scene(self.name)
        bodies = [*scene.surfaces.values(), *scene.objects.values()]
        parameters = [
            Parameter(body.name, quantity) for body in bodies for quantity in SUITE[body.role]
        ]
        made = assemble(scene, parameters)
        return Plan(
            made.measured,
            made.tree,
            "Every surface is probed, every object weighed and slid, whether or not "
            "it is known or asked for.",
            self.name,
            tuple(made.failed),
        )
