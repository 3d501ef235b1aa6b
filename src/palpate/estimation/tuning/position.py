"""Tuning numbers: centring by the fingers."""

CENTRING = 0.0015
"""m (1 sigma): fingers centre an object on themselves as they close; in simulated grasps it
ended up to 2.5 mm from where it had stood. Sensitive: position std ×0.5–2.0."""
