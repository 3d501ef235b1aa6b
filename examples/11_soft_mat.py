"""Press on a mat: its stiffness and damping, and a twin in which it gives way as it did."""

import palpate as pp
from palpate.studies.scenarios.catalogue import scenario

settings = scenario("soft_mat").settings()

run = pp.load(settings.scene).plan(settings.request).run(world=settings.world, seed=2)

for estimate in run.estimates:
    print(estimate)
(note,) = run.twin.notes
print(note)
print(next(line for line in run.twin.xml.splitlines() if "solref" in line).strip())
