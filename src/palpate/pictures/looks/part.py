"""Parts of a look, and the space that it fills."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.geometry.pose import Array
from palpate.pictures.looks.mesh import Mesh
from palpate.pictures.renderer import Pixels

Colour = tuple[float, float, float]
"""Red, green, blue, 0 to 1."""

WHITE: Colour = (1.0, 1.0, 1.0)
STEEL: Colour = (0.62, 0.64, 0.67)


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Surface of a look, in the body's frame.

    Attributes:
        colour: of the surface; what a print's colours are multiplied by.
        shine: 0 dull to 1 glossy.
        see_through: 0 opaque to 1 clear.
    """

    mesh: Mesh
    colour: Colour
    print: Pixels | None = None
    shine: float = 0.15
    see_through: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Space of a look: the box around a body's shapes, in the body's frame.

    Attributes:
        centre: (3,) m.
        half: (3,) half extents, m.
        colour: of its largest shape.
        drop: m from the box's foot down to the floor.
        main: the same of its largest shape alone, where there are several: a table's top.
    """

    centre: Array
    half: Array
    colour: Colour
    drop: float = 0.0
    main: Fit | None = None

    @property
    def radius(self) -> float:
        """Of what stands upright in it, m."""
        return float(min(self.half[0], self.half[1]))

    @property
    def ink(self) -> tuple[int, int, int]:
        """Its colour as a printer has it, 0 to 255."""
        red, green, blue = (round(255 * value) for value in self.colour)
        return red, green, blue
