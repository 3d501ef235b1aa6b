"""What a twin is good for: tasks planned with the scene as given and with the twin, carried out with the truth."""

from pathlib import Path

import palpate as pp

run = pp.run(Path(__file__).with_name("desk.xml"), "how heavy is the mug?", seed=0)

proof = run.prove()
print(proof)
for row in proof.rows:
    print(f"{row.task}: {row.says}")
