"""Room for the arm in a scene: no overlap at `home_config`, where every plan begins."""

from __future__ import annotations

from collections.abc import Iterator

from palpate.errors import InputError
from palpate.scene.scene import Scene
from palpate.vocabulary.admissible.solids import solids
from palpate.vocabulary.admissible.sweep.collision_geometry import LINK, arm_sweep
from palpate.vocabulary.admissible.sweep.sweep import Hit
from palpate.vocabulary.admissible.sweep.way import of_joints
from palpate.vocabulary.state import HOME_CONFIG, SymbolicState


def require_room(scene: Scene) -> None:
    """Require that nothing overlaps the arm at home: no plan helps against that.

    Raises:
        InputError: something overlaps a link, the hand or a closed finger there.
    """
    deepest = max(_overlaps(scene), key=lambda hit: -hit.distance, default=None)
    if deepest is None:
        return
    part, name = deepest.part.owner, deepest.other.owner
    raise InputError(
        "the arm has no room in this scene: at 'home_config', where every plan begins, its "
        f"{part} is {-1e3 * deepest.distance:.1f} mm inside '{name}', at {deepest.place}; correct "
        f"where '{name}' is or how large it is, or where the arm stands"
    )


def _overlaps(scene: Scene) -> Iterator[Hit]:
    """Bodies that overlap the arm at home. Its base may overlap its support."""
    home = scene.symbols.joints(HOME_CONFIG)
    still = of_joints(solids(scene), home, home, width=0.0)
    for hit in arm_sweep(SymbolicState(scene), still).within(0.0).overlaps():
        if hit.other.kind != LINK and hit.other.owner != scene.arm.base:
            yield hit
