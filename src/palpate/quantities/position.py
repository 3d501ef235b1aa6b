"""Plan position of a held object."""

from __future__ import annotations

import numpy as np

from palpate.estimation import tuning
from palpate.estimation.estimate import Estimate, not_measured
from palpate.estimation.windows import mean_pose
from palpate.mjcf.body import Body
from palpate.parameter import Parameter
from palpate.trace.samples import Trace

UNIT = "m"


def estimate_position(trace: Trace, parameter: Parameter, body: Body | None) -> Estimate:
    """World x-y of the midpoint between the fingers while they hold the object.

    Along the closing direction that is where the object is centred; across it, where it was
    grasped.

    Raises:
        ValueError: the recording holds no samples.
    """
    recording = trace.converted(parameter)
    if recording is None:
        return not_measured(parameter, UNIT)
    samples = trace.of(recording)
    position = mean_pose(samples).position[:2]
    spread = samples.pose_world_tcp[:, :2].std(axis=0) / np.sqrt(len(samples))
    std = np.hypot(np.hypot(spread, trace.hand.pose_repeatability), tuning.CENTRING)
    method = (
        "Mean position of the midpoint between the fingers while they hold the object, which they centre on "
        "themselves as they close."
    )
    return Estimate.normal(parameter, UNIT, position, std, method, (recording,))
