"""Ripple of gears in a pressing force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate.estimation.descent import joint_ripple, ripple_force
from palpate.robots.owner import load_description

CYCLES = 240.0
Q = 0.9 + np.linspace(0.0, 0.12, 1200)  # rad: four and a half cycles
FREE = np.arange(len(Q)) < 1000
RIPPLE = 0.15 * np.sin(CYCLES * Q + 1.0) + 0.1 * np.sin(2.0 * CYCLES * Q - 0.5)


def noise(size: float) -> np.ndarray:
    return size * np.random.default_rng(3).standard_normal(len(Q))


def test_ripple_goes_on_into_the_contact():
    pressed = np.where(FREE, 0.0, 40.0 * (Q - Q[1000]))
    found = joint_ripple(Q, 0.2 + 1.5 * Q + RIPPLE + pressed + noise(0.02), FREE, CYCLES)
    assert np.std(found[~FREE] - RIPPLE[~FREE]) < 0.1 * np.std(RIPPLE[~FREE])


def test_noise_and_other_waves_are_none():
    assert not joint_ripple(Q, noise(0.02), FREE, CYCLES).any()
    other = 0.15 * np.sin(0.4 * CYCLES * Q)
    assert np.std(joint_ripple(Q, other + noise(0.02), FREE, CYCLES)) < 0.5 * np.std(other)


def test_less_than_a_cycle_of_free_air_shows_none():
    short = np.arange(len(Q)) < 200
    assert not joint_ripple(Q, RIPPLE, short, CYCLES).any()


def test_only_an_arm_with_known_gears_has_ripple(bench, noises):
    b = bench(noises["lab"], 0)
    b.go("mat_approach", (0.5, 0.0, 0.32))
    b.descend(lambda z: max(0.0, 0.28 - z) * 1000, "mat")
    trace = b.trace()
    rows = slice(0, len(trace.samples))
    unknown = replace(trace, hand=replace(trace.hand, ripple_cycles=None))
    assert not ripple_force(unknown, rows, np.ones(len(trace.samples), dtype=bool)).any()


def test_gears_are_stated_for_recorded_arms():
    assert load_description("fr3").nominal.ripple_cycles == (240.0,) * 4 + (160.0,) * 3
    assert load_description("iiwa14").nominal.ripple_cycles is None
