"""Rigid body of a fitted load."""

import numpy as np
import pytest

from palpate.estimation.carried import fit_body
from palpate.estimation.rigid_bodies import about_centre, linear, of_box, pseudo_inertia

BOX = of_box(0.25, np.array([0.01, -0.02, 0.05]), np.array([0.12, 0.06, 0.08]))
TRUTH = linear(pseudo_inertia(BOX))
STDS = np.repeat([2e-3, 2e-4, 5e-4], (1, 3, 6))
"""kg, kg m and kg m² (1 sigma): a motion that hardly shows an inertia of 2e-4 kg m²."""


def test_an_exact_fit_is_kept():
    found = fit_body(TRUTH, np.diag((1e-4 * STDS) ** 2))
    assert about_centre(found.theta) == pytest.approx(about_centre(BOX), rel=1e-3, abs=1e-7)
    assert found.misfit < 1e-3


def test_a_light_load_has_the_inertia_of_a_likely_body():
    """The fit alone is 500 kg mm² off."""
    random, errors, stds = np.random.default_rng(0), [], []
    for _ in range(40):
        found = fit_body(TRUTH + STDS * random.normal(size=10), np.diag(STDS**2))
        # Central differences of the inertia by the parameters of the body.
        steps = 1e-6 * np.eye(10)
        slopes = np.column_stack(
            [(about_centre(found.theta + s) - about_centre(found.theta - s)) / 2e-6 for s in steps]
        )
        errors.append(about_centre(found.theta) - about_centre(BOX))
        stds.append(np.sqrt(np.diag(slopes @ found.covariance @ slopes.T)))
        xx, yy, zz = about_centre(found.theta)[:3]
        assert max(xx, yy, zz) < xx + yy + zz - max(xx, yy, zz)
    assert np.sqrt(np.mean(np.square(errors))) < 300e-6
    assert np.sqrt(np.mean(np.square(stds))) < 400e-6
    assert np.mean(np.abs(errors) < 1.96 * np.array(stds)) > 0.92


def test_the_body_follows_the_fit_by_its_gain():
    covariance = np.diag((0.02 * STDS) ** 2)
    found, step = fit_body(TRUTH, covariance), 1e-3 * STDS
    moved = fit_body(TRUTH + step, covariance)
    assert moved.theta - found.theta == pytest.approx(found.gain @ step, rel=0.05, abs=1e-5)
