"""What the robot felt: a run saved, opened again, and its trace read: actions, recordings, forces."""

from pathlib import Path
from tempfile import TemporaryDirectory

import palpate as pp

desk = Path(__file__).with_name("desk.xml")

with TemporaryDirectory() as folder:
    pp.run(desk, "how heavy is the mug?", noise="lab").save(f"{folder}/mug")
    run = pp.open(f"{folder}/mug")
    trace = run.trace

print(run)
print(trace)
for recording in trace.recordings:
    force = trace.of(recording).wrench[:, 2].mean()
    print(f"{recording.buffer}, holding the {recording.context.holding}: F_z = {force:.2f} N")
