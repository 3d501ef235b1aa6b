"""A finished run, played again: a slider over its time moves the arm, and what it held, through the trace."""

from __future__ import annotations

from viser import GuiApi, GuiHtmlHandle

from palpate.live.outline import Line, outline
from palpate.live.shapes import Drawn
from palpate.pictures.posed import PosedCell, Replay
from palpate.trace.recording import LeafRun
from palpate.trace.samples import Trace

STEP = 0.05
"""s of the slider."""


class Player:
    """Moves the cell to any instant of a trace.

    Args:
        gui: where the slider goes.
        trace: what is played.
        cell: what is posed.
        drawn: how it is seen.
        tree: where the leaves are listed.
    """

    def __init__(
        self, gui: GuiApi, trace: Trace, cell: PosedCell, drawn: Drawn, tree: GuiHtmlHandle
    ) -> None:
        self._trace, self._cell, self._drawn, self._tree = trace, cell, drawn, tree
        self._replay = Replay(cell, trace)
        last = float(trace.t[-1] - trace.t[0])
        slider = gui.add_slider("time / s", 0.0, max(last, STEP), STEP, last, order=0.5)
        slider.on_update(lambda _: self.show(float(slider.value)))
        self.show(last)

    def show(self, seconds: float) -> None:
        """Pose everything as it was so long after the beginning."""
        t = float(self._trace.t[0]) + seconds
        self._replay.show(t)
        self._drawn.move(self._cell.data)
        self._tree.content = outline(_line(leaf, t) for leaf in self._trace.leaves)


def _line(leaf: LeafRun, t: float) -> Line:
    """The leaf as it was at a time."""
    if t < leaf.start:
        return Line(leaf.label, 0, "INVALID")
    if t < leaf.end:
        return Line(leaf.label, 0, "RUNNING")
    return Line(leaf.label, 0, leaf.status, leaf.message)
