"""A motion that excites a load keeps the arm's limits."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

from palpate.common.errors import InputError
from palpate.estimation.logs.excitation import MARGIN, PERIOD, SPEED_SHARE, excitation
from palpate.robots.owner import load_description
from palpate.runs.tools import write_excitation


@pytest.mark.parametrize("name", ["fr3", pytest.param("iiwa14", marks=pytest.mark.long)])
def test_limits_are_kept_from_rest_to_rest(name: str) -> None:
    arm = load_description(name)
    found = excitation(arm)
    t = np.arange(0.0, PERIOD + 1e-9, 0.01)
    q, dq, ddq = found.sample(t)
    for end in (0, -1):
        np.testing.assert_allclose(q[end], arm.home, atol=1e-9)
        np.testing.assert_allclose(dq[end], 0.0, atol=1e-9)
        np.testing.assert_allclose(ddq[end], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.gradient(q, t, axis=0)[1:-1], dq[1:-1], atol=2e-3)
    assert (q > arm.limits.q_min + 0.9 * MARGIN).all()
    assert (q < arm.limits.q_max - 0.9 * MARGIN).all()
    assert (np.abs(dq) < 1.02 * SPEED_SHARE * arm.limits.dq_max).all()
    assert found.condition < 200.0


def test_the_file_and_what_to_record(tmp_path: Path) -> None:
    file = tmp_path / "motion.csv"
    told = "\n".join(write_excitation("fr3", file))
    assert str(file) in told
    assert "palpate estimate LOG --loaded A-B" in told
    rows = np.genfromtxt(io.StringIO(file.read_text()), delimiter=",", names=True)
    assert rows.dtype.names[:3] == ("t", "q1", "q2")
    assert rows["t"][-1] == 3 * PERIOD
    with pytest.raises(InputError, match="exists already"):
        write_excitation("fr3", file)
