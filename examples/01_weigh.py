"""Weigh an object: from a scene and a sentence to a number with its error bar."""

from pathlib import Path

import palpate as pp

desk = Path(__file__).with_name("desk.xml")

run = pp.run(desk, "how heavy is the mug?", seed=0)

mug = run["mug.mass"]
print(run)
print(mug)
print(f"{mug.value:.4f} ± {mug.std:.4f} {mug.unit}, by: {mug.method}")
