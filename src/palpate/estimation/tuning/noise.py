"""Tuning numbers: noise of the joint sensors."""

SHORT_BLOCK = 0.05
"""s: means over such blocks show the white noise; long enough for a filter of the signals to have
forgotten. Sensitive: mass 0.2 σ, std ×0.9–1.2."""

LONG_BLOCK = 0.25
"""s: means over such blocks show what is slower; some of them fit into the shortest pass.
Sensitive: mass 0.3 σ, std ×0.8–1.5."""

SMOOTH_DEGREE = 2
"""degree of the polynomial in time that is no noise of a stretch. Sensitive: mass 0.1 σ, std
×0.9–1.2."""

FLICKER_SPAN = 4.0
"""s for which white noise is averaged in a pass, to compare it with what is slower. Sensitive:
no."""

FLICKER_FREEDOM = (6.0, 20.0)
"""degrees of freedom that the level of 1/f noise has at least and at most, between which the number of blocks of
`LONG_BLOCK` decides: where it hardly stands out it is known to a factor of two or so; where many blocks show it,
it is still extrapolated to a run of some ten seconds (in 75 recorded runs with a known level its square came out
at 0.7 to 1.25 of that). Sensitive: 95 % intervals ×0.9–1, no std."""

GAP = 3.0
"""sampling periods from which samples are missing. Sensitive: no."""

STANDS_OUT = 2.0
"""standard deviations by which long blocks scatter more than white noise lets them, before that is
taken for 1/f noise. Sensitive: mass 0.2 σ, std ×0.8–1.2."""

OVERLAP = 2.0
"""second differences of neighbouring blocks per independent one. Sensitive: mass 0.1 σ, std
×0.9–1.1."""
