"""Uncertainty of the gains of an arm's torque sensors."""

from __future__ import annotations

import numpy as np

from palpate.geometry.pose import Array
from palpate.trace.recording import Hand


def gain_root(hand: Hand, signals: int) -> Array:
    """(m, m): what m independent causes, at one standard deviation each, do to the relative gains of
    m `signals`.

    A stated half width is that of a uniform distribution in each (GUM, JCGM 100:2008, 4.3.7). Of
    joints that were measured it is the symmetric root of their covariance, so that each cause is
    mostly one joint's.
    """
    if hand.gain_covariance is None or len(hand.gain_covariance) != signals:
        return hand.torque_gain / np.sqrt(3.0) * np.eye(signals)
    sizes, axes = np.linalg.eigh(np.array(hand.gain_covariance))
    return (axes * np.sqrt(np.maximum(sizes, 0.0))) @ axes.T
