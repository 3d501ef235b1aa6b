#!/usr/bin/env bash
# Each call of the toolbox's `apply_delay` delays the recording that it was given, once more.
#
# Packages: mujoco==4.0.0 numpy==2.4.6 scipy==1.17.1 absl-py==2.5.1 colorama==0.4.6 tabulate==0.10.0 pyyaml==6.0.4.
# Expected: `apply_delay` returns a delayed copy, as `apply_bias` and `apply_gain` do.
# Happens: The result shares its array with the input, which is overwritten. The third call with a delay of 10 ms
# returns data delayed by 30 ms.
# Why it matters: An optimiser calls the modifier once per residual. A delay of force sensor against joint encoder
# is then identified from data that move under it.
# Source: mujoco/sysid/_src/signal_modifier.py: apply_bias and apply_gain copy the data first, apply_delay writes
# into `ts.data`.
#
# Exit status 0: as described. Another one: the behaviour has changed, or a package is not to be had.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 numpy==2.4.6 scipy==1.17.1 absl-py==2.5.1 colorama==0.4.6 \
  tabulate==0.10.0 pyyaml==6.0.4
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from mujoco import sysid

times = 0.01 * np.arange(200)


def record() -> sysid.TimeSeries:
    """Return a ramp of 1 N/s: its value is its time."""
    mapping = {"force": (sysid.SignalType.MjSensor, np.array([0]))}
    return sysid.TimeSeries(times, times[:, None].copy(), mapping)


delay, one = sysid.Parameter("delay", 0.01, 0, 1), sysid.Parameter("one", 1.0, 0, 2)
found = []
print("mujoco", version("mujoco"))
series = record()
for call in range(1, 4):
    result = sysid.apply_delay(series, "force", delay)
    found.append(1e3 * (times[100] - result.data[100, 0]))
    print(
        f"call {call}: asked for 10 ms, delayed by {found[-1]:.1f} ms,"
        f" input changed: {not np.allclose(series.data[:, 0], times)}"
    )
assert np.allclose(found, [10, 20, 30])
series = record()
for modify in (sysid.apply_bias, sysid.apply_gain):
    modify(series, "force", one)
    print(f"{modify.__name__}: input changed: {not np.allclose(series.data[:, 0], times)}")
    assert np.allclose(series.data[:, 0], times)
PYTHON
