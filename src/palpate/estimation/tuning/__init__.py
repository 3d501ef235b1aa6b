"""Tuning numbers of the estimators: value, unit, reason and measured sensitivity of each.

*Sensitive* says what becomes of an estimate when the number is halved or doubled (one that cannot
exceed 1: half way to 1): by how many of its own standard deviations σ it moves at most, and between
which factors its standard deviation changes, of 28 estimates: four bundled scenarios and synthetic
recordings, at the noise of `lab` and `datasheet`. *Hardly* is less than 0.05 σ and 5 %; *no* is a
threshold between cases that lie far apart, or a prior that says nothing.

What an arm and a hand are known for (the length of the tips, the datasheet's accuracies) is not
tuned: it comes with the trace, in `trace.hand`.

Each concern has a file of its own; `tuning.NAME` finds a number whichever it stands in.
"""

from palpate.estimation.tuning.arm import *
from palpate.estimation.tuning.contact import *
from palpate.estimation.tuning.fixture import *
from palpate.estimation.tuning.friction import *
from palpate.estimation.tuning.held import *
from palpate.estimation.tuning.load import *
from palpate.estimation.tuning.shared import *
