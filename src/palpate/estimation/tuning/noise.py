"""How noisily joints are sensed: the numbers."""

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

FLICKER_FREEDOM = 6.0
"""degrees of freedom of noise that is extrapolated from blocks of `LONG_BLOCK` to a run of some ten
seconds: its level is known to a factor of two or so. Sensitive: no."""

GAP = 3.0
"""sampling periods from which samples are missing. Sensitive: no."""

STANDS_OUT = 2.0
"""standard deviations by which long blocks scatter more than white noise lets them, before that is
taken for 1/f noise. Sensitive: mass 0.2 σ, std ×0.8–1.2."""

OVERLAP = 2.0
"""second differences of neighbouring blocks per independent one. Sensitive: mass 0.1 σ, std
×0.9–1.1."""
