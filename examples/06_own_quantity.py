"""A quantity of your own: one class says what it is called, where it stands in MJCF, and whether it is known.

Here the rolling friction, third number of MuJoCo's `friction`. Installed packages bring theirs through the
entry-point group `palpate.quantities`, with an estimator; here the catalogue is passed on by hand.
"""

from pathlib import Path
from typing import ClassVar

import palpate as pp
from palpate.estimation.quantities.catalogue import Catalogue, catalogue
from palpate.estimation.quantities.quantity import Prior
from palpate.scene.load import parse_scene


class RollingFriction(pp.Quantity):
    id, unit, subject = "rolling", "m", "object"
    label = "rolling friction"
    words: ClassVar = {"en": ("rolling friction",)}

    def status(self, body):
        stated = [geom.get("friction", "").split() for geom in body.elements.geoms]
        return "known" if all(len(numbers) == 3 for numbers in stated) else "missing"

    def known(self, body):
        return (float(body.elements.geoms[0].get("friction").split()[2]),)

    def prior(self, body, believed):
        return Prior((1e-4,), (5e-5,))


quantities = Catalogue([*catalogue().values(), RollingFriction()])
text = Path(__file__).with_name("desk.xml").read_text()
for wording in ("0.7 0.005 0.0001", "0.7"):
    scene = parse_scene(text.replace("0.7 0.005 0.0001", wording), quantities=quantities)
    print(f'friction="{wording}": missing', *scene.missing)
