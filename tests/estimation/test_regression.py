"""Linear-Gaussian regression against brute force and simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.estimation.regression import Cause, PriorScale, Projected, SignalNoise, fit

SIGNALS, ROWS = 3, 20


def problem(seed: int):
    random = np.random.default_rng(seed)
    count = SIGNALS * ROWS
    sizes = {"load": (1, 100.0), "friction": (SIGNALS, 0.3), "gain": (2, 0.01)}
    causes = [
        Cause(name, random.standard_normal((count, k)), np.full(k, prior))
        for name, (k, prior) in sizes.items()
    ]
    roots = []
    for _ in range(SIGNALS):
        half = random.standard_normal((ROWS, ROWS))
        roots.append(np.linalg.cholesky(half @ half.T / ROWS + np.eye(ROWS)))
    return causes, SignalNoise(roots, 50.0), random.standard_normal(count)


def dense(causes, noise):
    design, prior = (
        np.concatenate([getattr(c, of) for c in causes], axis=-1) for of in ("columns", "prior")
    )
    sigma = np.zeros((len(design), len(design)))
    for i, root in enumerate(noise.roots):
        here = slice(i * ROWS, (i + 1) * ROWS)
        sigma[here, here] = root @ root.T
    return design, prior, sigma


@pytest.mark.parametrize("seed", range(3))
def test_posterior_is_that_of_the_normal_equations(seed):
    causes, noise, y = problem(seed)
    design, prior, sigma = dense(causes, noise)
    inverse = np.linalg.inv(sigma)
    covariance = np.linalg.inv(design.T @ inverse @ design + np.diag(prior**-2.0))
    found = fit(causes, noise, y)
    assert found.covariance == pytest.approx(covariance, rel=1e-8, abs=1e-12)
    assert found.mean == pytest.approx(covariance @ design.T @ inverse @ y, rel=1e-8)
    mean, spread = found["friction"]
    assert mean == pytest.approx(found.mean[1:4])
    assert spread == pytest.approx(covariance[1:4, 1:4])


def test_evidence_is_the_density_of_the_rows():
    causes, noise, y = problem(3)
    design, prior, sigma = dense(causes, noise)
    whole = sigma + (design * prior**2) @ design.T
    density = -0.5 * (y @ np.linalg.solve(whole, y) + np.linalg.slogdet(whole)[1])
    assert fit(causes, noise, y).evidence == pytest.approx(density, rel=1e-9)


def test_a_scale_of_a_prior_is_learned():
    causes, noise, y = problem(4)
    friction = causes[1].columns @ np.array([20.0, -10.0, 15.0])
    scale = PriorScale(("friction",), (1.0, 50.0), (0.9, 0.1))
    mean, _ = fit(causes, noise, y + friction, [scale])["friction"]
    narrow, _ = fit(causes, noise, y + friction)["friction"]
    assert np.all(np.abs(mean) > np.abs(narrow))
    assert mean == pytest.approx([20.0, -10.0, 15.0], abs=2.0)


@pytest.mark.parametrize("scaled", [("friction",), ("gain", "load"), ("load", "friction", "gain")])
def test_the_posterior_is_the_mixture_over_all_scales(scaled):
    causes, noise, y = problem(6)
    scales = [
        PriorScale(scaled, (0.1, 1.0, 10.0), (0.3, 0.3, 0.4)),
        PriorScale(scaled[:1], (1.0, 3.0), (0.5, 0.5)),
    ]
    found, weights, parts = fit(causes, noise, y, scales), [], []
    for factor, chance in zip(scales[0].factors, scales[0].chance, strict=True):
        for further in scales[1].factors:
            by = {name: factor * (further if name == scaled[0] else 1.0) for name in scaled}
            each = [replace(c, prior=c.prior * by.get(c.name, 1.0)) for c in causes]
            parts.append(fit(each, noise, y))
            weights.append(np.log(0.5 * chance) + parts[-1].evidence)
    assert found.evidence == pytest.approx(np.logaddexp.reduce(weights), abs=1e-4)
    weights = np.exp(weights - np.logaddexp.reduce(weights))
    mean = sum(w * part.mean for w, part in zip(weights, parts, strict=True))
    spread = [part.covariance + np.outer(part.mean - mean, part.mean - mean) for part in parts]
    covariance = sum(w * part for w, part in zip(weights, spread, strict=True))
    # Improbable scales are left out.
    assert np.all(np.abs(found.mean - mean) < 1e-3 * np.sqrt(np.diag(covariance)))
    assert found.covariance == pytest.approx(covariance, rel=1e-2, abs=1e-6)
    assert found.covariance == pytest.approx(found.covariance.T)
    assert found.model.solve(2)[1] == pytest.approx(found.covariance[:2])
    columns = np.random.default_rng(7).standard_normal((len(y), 2))
    means, variances = found.each_alone(columns, 0.5)
    for i in range(2):
        further = Cause("further", columns[:, i : i + 1], np.array([0.5]))
        mean, variance = fit([*causes, further], noise, y, scales)["further"]
        assert means[i] == pytest.approx(mean[0], abs=1e-3 * variance[0, 0] ** 0.5)
        assert variances[i] == pytest.approx(variance[0, 0], rel=1e-2)


def test_an_unknown_without_a_prior_is_one_with_an_enormous_prior():
    causes, noise, y = problem(5)
    free = Cause("free", causes[1].columns, np.full(SIGNALS, 1e6))
    projected = fit([causes[0], causes[2]], Projected.of(noise, free.columns), y)
    mean, covariance = fit([causes[0], causes[2], free], noise, y)["load"]
    assert projected["load"][0] == pytest.approx(mean, rel=1e-6)
    assert projected["load"][1] == pytest.approx(covariance, rel=1e-6)


def test_shared_errors_are_no_more_than_the_deviation():
    causes, noise, y = problem(6)
    gain = causes[2]
    shared = Cause(
        gain.name, gain.columns, gain.prior, "arm", ("gain of joint 1", "gain of joint 2")
    )
    found = fit([causes[0], causes[1], shared], noise, y)
    effects = {one.cause: one.effect[0] for one in found.shared("load")}
    assert set(effects) == {"gain of joint 1", "gain of joint 2"}
    # A wrong gain, by one standard deviation, moves the load by the effect.
    wrong = gain.columns[:, 0] * gain.prior[0]
    moved = fit([causes[0], causes[1], shared], noise, y + wrong)["load"][0] - found["load"][0]
    assert moved == pytest.approx([effects["gain of joint 1"]])
    assert abs(moved[0]) < np.sqrt(found["load"][1][0, 0])


@pytest.mark.parametrize("cause", [1, 2])
def test_shared_errors_are_those_of_the_learned_scales(cause):
    causes, noise, y = problem(7)
    causes[cause] = replace(
        causes[cause], of="scene", prior=0.02 * np.ones_like(causes[cause].prior)
    )
    name = causes[cause].name
    # The recording has a hundred times the prior deviation.
    y = y + causes[cause].columns @ (100.0 * causes[cause].prior)
    factors, chances = (0.0, 1.0, 100.0), (0.9, 0.08, 0.02)
    found = fit(causes, noise, y, [PriorScale((name,), factors, chances)])
    wider = replace(causes[cause], prior=100.0 * causes[cause].prior)
    large = fit([wider if one.name == name else one for one in causes], noise, y)
    shared = np.array([one.effect[0] for one in found.shared("load")])
    assert shared == pytest.approx(large.effects(name)[0], rel=1e-3)
    every = np.array([np.sum(found.effects(one.name) ** 2, axis=1) for one in causes]).sum(axis=0)
    assert (every <= 1.000001 * np.diag(found.covariance)).all()


def test_a_further_cause_fails_its_test_only_where_it_acts():
    causes, noise, y = problem(7)
    pull = Cause("pull", np.random.default_rng(8).standard_normal((len(y), 1)), np.array([1e3]))
    white = noise.white(np.eye(len(y)))
    quiet = np.linalg.solve(white, np.random.default_rng(9).standard_normal(len(y)))
    found = fit(causes, noise, quiet).test(pull, np.array([0.0]), "It is pulled.")
    assert found.passed
    assert found.name == "pull"
    assert (
        not fit(causes, noise, quiet + 5.0 * pull.columns[:, 0])
        .test(pull, np.array([0.0]), "It is pulled.")
        .passed
    )
