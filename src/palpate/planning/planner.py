"""What a planner is, and how the command line's words become one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from palpate.errors import InputError
from palpate.planning.plan import Plan

if TYPE_CHECKING:
    from palpate.scene.scene import Scene

MAX_REQUEST = 4_000
"""Characters: a request is a sentence or a paragraph, not a document."""


class Planner(Protocol):
    """f(R, D, I) → plan."""

    @property
    def name(self) -> str:
        """As written on the command line; kept in `Plan.planner`."""
        ...

    def plan(self, request: str | None, scene: Scene | None, images: Sequence[Path] = ()) -> Plan:
        """A plan for the request and what the scene misses; its tree is None when nothing of it can
        be measured.

        Without a scene only who can look at the images can plan.

        Raises:
            InputError: a request that cannot be used. PlanRejected: no plan; the message explains.
            Unavailable: a provider out of reach.
        """
        ...


def needs_scene(planner: str) -> InputError:
    """What to tell who wants a planner that cannot look to plan without D."""
    return InputError(
        f"the {planner} planner needs a scene to work on: give an MJCF with --scene D.xml, or let a "
        "model look at a picture: --planner PROVIDER:MODEL --image I.png --poses poses.yaml (with its "
        "camera)"
    )
