"""Runs compared: better and worse sensors against the truth of the simulated world, and what is claimed."""

from pathlib import Path

import palpate as pp

plan = pp.load(Path(__file__).with_name("desk.xml")).plan("how heavy is the mug?")

print("noise       mass      std      error    error / std")
for noise in ("none", "lab", "datasheet"):
    run = plan.run(noise=noise, seed=3)
    mug = run["mug.mass"]
    truth = run.truth[mug.parameter]
    mass, std, score = mug.value, mug.std, mug.z_score(truth)
    print(f"{noise:9s} {mass:.4f} kg {std:.4f} kg {mass - truth[0]:+.4f} kg {score:+.2f}")
