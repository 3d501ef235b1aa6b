"""Poses along a line, of which a run takes one."""

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.geometry.line import SPACING, Line
from palpate.geometry.pose import Pose

LINE = Line.through(
    Pose.of([0.5, 0.0, 0.1]), np.array([0.0, 0.05, 0.0]), np.array([0.6, 0.02, 0.0])
)


def test_what_is_believed_is_the_place_nearest_to_a_point():
    assert LINE.believed == pytest.approx(0.02)
    assert LINE.at(LINE.believed).position == pytest.approx([0.5, 0.02, 0.1])


def test_no_place_is_outside_the_region():
    assert LINE.nearest(np.array([0.5, 0.3, 0.0])) == pytest.approx(0.05)
    with pytest.raises(InputError, match="60 mm along is outside -50 to 50 mm"):
        LINE.at(0.06)


def test_places_hold_both_ends_and_are_close():
    places = LINE.places()
    assert places[0] == pytest.approx(-0.05)
    assert places[-1] == pytest.approx(0.05)
    assert np.diff(places).max() <= SPACING + 1e-12
