"""From what was felt to the number, for each quantity that there is a picture of."""

from __future__ import annotations

import logging
from collections.abc import Callable

from palpate.report.data import Measured
from palpate.report.evidence.chart import Chart
from palpate.report.evidence.fit import fit_chart
from palpate.report.evidence.gripping import centred_charts, gripped_charts
from palpate.report.evidence.holding import held_charts
from palpate.report.evidence.leaning import leaned_charts
from palpate.report.evidence.pressing import pressed_charts
from palpate.report.evidence.sliding import slid_charts
from palpate.report.evidence.swinging import swung_charts
from palpate.report.evidence.tilting import balanced_charts
from palpate.report.evidence.touching import touched_charts
from palpate.trace.samples import Trace

log = logging.getLogger(__name__)

CHARTS: dict[str, Callable[[Measured, Trace], tuple[Chart, ...]]] = {
    "com": held_charts,
    "com_3d": balanced_charts,
    "inertia": swung_charts,
    "friction": slid_charts,
    "height": touched_charts,
    "tilt": leaned_charts,
    "stiffness": pressed_charts,
    "size": gripped_charts,
    "position": centred_charts,
}
"""By quantity. A quantity without an entry shows its windows alone."""


def charts(measured: Measured, trace: Trace) -> tuple[Chart, ...]:
    """None where there is nothing to draw, or what was recorded does not show it."""
    draw = CHARTS.get(measured.estimate.parameter.quantity)
    if not measured.estimate.has_value or not len(trace.samples):
        return ()
    try:
        if measured.estimate.views or draw is None:
            return tuple(fit_chart(view, measured) for view in measured.estimate.views)
        return draw(measured, trace)
    except (ValueError, IndexError, StopIteration):
        # A recording that was cut short; the page still says what was estimated, and of what.
        return ()
    except Exception as error:
        # The page is worth more than one of its charts.
        log.warning(
            "no chart of %s: %s: %s", measured.estimate.parameter, type(error).__name__, error
        )
        return ()
