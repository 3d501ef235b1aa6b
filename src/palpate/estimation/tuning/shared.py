"""Tuning numbers of several estimators: goodness-of-fit tests, and systematic errors of any force."""

FALSE_ALARM = 1e-4
"""Probability that one test of fit fails although the model holds: an estimate has up to ten, and some thousand
valid estimates in a row shall stay identified. Sensitive: no."""

PAUSE = 0.5
"""s between two stretches of one pass, at most: a motion changes its speed near things. Sensitive: no."""

UNKNOWN_NOISE = 0.01
"""N², (N m)²: variance of a row where no rest is long enough to show it. Sensitive: no."""

FORCE_BIAS = 0.5
"""N (1 sigma): bias of an unreferenced force; Franka states 0.8 N relative accuracy. Sensitive: hardly; without any
pass or rest of the empty hand it is most of a mass's std."""

TORQUE_LEVER = 0.3
"""m: converts these forces to moments about the TCP (typical lever of the wrist joints). Sensitive: com 0.07 σ, std
×0.9–1.1."""

KIND_BIAS = 0.3
"""N (1 sigma): deviation of the bias of one kind of segment from the common one, and its slope and curvature along
the path (friction hysteresis). Sensitive: mass 0.08 σ; com 0.1 σ."""

FLOOR = 1e-4
"""N: noise that is always assumed, as perfect sensors make the equations singular. Sensitive: no."""

GAIN_RATIO = 0.8
"""error (1 sigma) of a quotient of two forces, in half widths of a gain: different joints bear them, sqrt(2) times a
uniform error, 1/sqrt(3). Sensitive: friction std ×0.6–1.9."""

TILT = 0.009
"""rad (1 sigma): how far a support is out of level, half a degree; slides both ways show it. Sensitive: friction 0.1
σ; std of a slide one way ×0.8–1.7."""

VIEW_STRETCH = 0.5
"""s of free motion that the chart of a fit shows as one point. Sensitive: no, no value rests on a chart."""

VIEW_LEVEL = 0.0175
"""rad: a hand that leans by less counts as level in a chart. Sensitive: no."""

VIEW_SAME_WAY = 0.9
"""cosine between two leans of the hand that a chart shows as one tilt. Sensitive: no."""

VIEW_ABOVE = 0.006
"""m of free air that a chart of a touch shows at least. Sensitive: no."""

VIEW_FREE_AIR = 0.25
"""part of the depth: so much free air a chart of a press shows. Sensitive: no."""

VIEW_CLOSING = 0.4
"""s before the fingers begin to close that a chart of a grasp shows. Sensitive: no."""
