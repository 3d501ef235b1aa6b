"""A recording of an arm that carries a load in a window, with friction of a law that no estimator has."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from palpate.estimation.logs.excitation import excitation
from palpate.robots.owner import load_description

MASS, COM, INERTIA = 0.4, (0.01, -0.006, 0.03), (2e-3, 1.5e-3, 1e-3)
"""kg, m and kg m² about the centre of mass, in the tool's axes from the TCP."""
WINDOW = (12.4, 23.6)
COULOMB = np.array([0.5, 0.4, 0.3, 0.3, 0.35, 0.25, 0.15])
OFFSET = np.array([-0.3, -0.2, 0.0, -0.3, 0.0, 0.1, -0.2])
Log = dict[str, np.ndarray]


def torques(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, load: bool) -> np.ndarray:
    """Torques behind the gears that move the arm, by MuJoCo, with a body welded to its hand."""
    arm = load_description("fr3")
    spec = arm.spec(np.array([0.0, 0.0, -9.81]))
    if load:
        hand, site = spec.body(arm.hand.body), spec.site(arm.tcp)
        hand.add_body(
            name="load", pos=site.pos, mass=MASS, ipos=COM, inertia=INERTIA, explicitinertial=True
        )
    model = spec.compile()
    model.dof_armature[:] = 0.0
    data, out = mujoco.MjData(model), np.empty(q.shape)
    data.qpos[7:] = arm.hand.opening / 4
    for i in range(len(q)):
        data.qpos[:7], data.qvel[:7], data.qacc[:7] = q[i], dq[i], ddq[i]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        full = np.empty(model.nv)
        mujoco.mj_rne(model, data, 1, full)
        out[i] = full[:7]
    return out


@pytest.fixture(scope="session")
def recording() -> Log:
    """24 s at 200 Hz: a period with the empty hand, and one with the load."""
    random, t = np.random.default_rng(1), np.arange(4800) / 200
    q, dq, ddq = excitation(load_description("fr3")).sample(t)
    held = t > 12.0
    tau = np.where(held[:, None], torques(q, dq, ddq, True), torques(q, dq, ddq, False))
    tau += COULOMB * np.tanh(dq / 0.02) * (1 + 0.1 * np.cos(q)) + OFFSET
    tau += random.normal(size=tau.shape) * 0.03
    return {"t": t + 3.0, "q": q, "dq": dq, "tau": tau}


@pytest.fixture(scope="session")
def npz(recording: Log, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording as an archive."""
    file = tmp_path_factory.mktemp("recording") / "log.npz"
    np.savez(file, **recording)
    return file
