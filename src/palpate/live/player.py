"""A finished run, played again: a slider over its time moves the arm, and what it held, through the trace."""

from __future__ import annotations

import numpy as np
from viser import GuiApi, GuiHtmlHandle

from palpate.geometry.pose import Pose
from palpate.live.outline import Line, outline
from palpate.live.posed import PosedCell
from palpate.live.shapes import Drawn
from palpate.trace.recording import LeafRun
from palpate.trace.samples import Trace

STEP = 0.05
"""s of the slider."""


class Player:
    """Moves the cell to any instant of a trace.

    Args:
        gui: where the slider goes. trace: what is played. cell: what is posed. drawn: how it is seen.
        tree: where the leaves are listed.
    """

    def __init__(
        self, gui: GuiApi, trace: Trace, cell: PosedCell, drawn: Drawn, tree: GuiHtmlHandle
    ) -> None:
        self._trace, self._cell, self._drawn, self._tree = trace, cell, drawn, tree
        last = float(trace.t[-1] - trace.t[0])
        slider = gui.add_slider("time / s", 0.0, max(last, STEP), STEP, last, order=0.5)
        slider.on_update(lambda _: self.show(float(slider.value)))
        self.show(last)

    def show(self, seconds: float) -> None:
        """Pose everything as it was so long after the beginning."""
        samples = self._trace.samples
        t = float(samples.t[0]) + seconds
        self._cell.put_back()
        holding = None
        for leaf in self._trace.leaves:
            if leaf.end > t:
                break
            if leaf.context is not None and leaf.context.holding != holding:
                self._cell.carry(self._tcp(leaf.end), holding)
                holding = leaf.context.holding
                self._cell.carry(self._tcp(leaf.end), holding)
        row = self._row(t)
        self._cell.show(samples.q[row], float(samples.width[row]), self._tcp(t), holding)
        self._drawn.move(self._cell.data)
        self._tree.content = outline(_line(leaf, t) for leaf in self._trace.leaves)

    def _row(self, t: float) -> int:
        return int(np.clip(np.searchsorted(self._trace.t, t), 0, len(self._trace.t) - 1))

    def _tcp(self, t: float) -> Pose:
        x = self._trace.samples.pose_world_tcp[self._row(t)]
        return Pose.of(x[:3], x[3:])


def _line(leaf: LeafRun, t: float) -> Line:
    """The leaf as it was at a time."""
    if t < leaf.start:
        return Line(leaf.label, 0, "INVALID")
    if t < leaf.end:
        return Line(leaf.label, 0, "RUNNING")
    return Line(leaf.label, 0, leaf.status, leaf.message)
