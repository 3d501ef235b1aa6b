"""Temperature, read by a person from a thermometer that the arm holds."""

from __future__ import annotations

from typing import ClassVar

from palpate.estimation.quantities.quantity import Evidence, Quantity


class Temperature(Quantity):
    """Temperature of an object.

    It is in no catalogue: no primitive of palpate reads it, and MJCF has no place for it.
    """

    id = "temperature"
    unit = "°C"
    subject = "object"
    words: ClassVar = {"en": ("temperature", "hot", "warm", "cold")}
    evidence = (
        Evidence(
            "",
            "a person reads the thermometer while it is held over the object",
            tool="thermometer",
            place="probe",
        ),
    )
    identifiable = False
