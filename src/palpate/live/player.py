"""Playback of a finished run: a slider over its time, and a button that moves it."""

from __future__ import annotations

import threading
import time

from viser import GuiApi, GuiHtmlHandle

from palpate.live.markup import Line, outline
from palpate.live.shapes import Drawn
from palpate.pictures.posed import PosedCell, Replay
from palpate.trace.recording import LeafRun
from palpate.trace.samples import Trace

STEP = 0.05
"""s of the slider."""
FRAME = 1 / 20
"""s of wall time between two pictures of a playback."""
SPEEDS = ("1x", "4x", "16x")


class Player:
    """Moves the cell to any instant of a trace.

    Args:
        gui: for the controls.
        trace: of the run.
        cell: is posed.
        drawn: its bodies in the view.
        tree: lists the leaves.
    """

    def __init__(
        self, gui: GuiApi, trace: Trace, cell: PosedCell, drawn: Drawn, tree: GuiHtmlHandle
    ) -> None:
        self._trace, self._cell, self._drawn, self._tree = trace, cell, drawn, tree
        self._replay = Replay(cell, trace)
        self._last = max(float(trace.t[-1] - trace.t[0]), STEP)
        self._playing = threading.Event()
        self._button = gui.add_button("Play", order=0.4)
        self._button.on_click(lambda _: self._toggle())
        self._speed = gui.add_dropdown("speed", SPEEDS, initial_value="4x", order=0.45)
        self._slider = gui.add_slider("time / s", 0.0, self._last, STEP, self._last, order=0.5)
        self._slider.on_update(lambda _: self.show(float(self._slider.value)))
        self.show(self._last)

    def show(self, seconds: float) -> None:
        """Pose everything at a time after the beginning, s."""
        t = float(self._trace.t[0]) + seconds
        self._replay.show(t)
        self._drawn.move(self._cell.data)
        self._tree.content = outline(_line(leaf, t) for leaf in self._trace.leaves)

    def _toggle(self) -> None:
        if self._playing.is_set():
            self._playing.clear()
            return
        self._playing.set()
        threading.Thread(target=self._play, name="playback", daemon=True).start()

    def _play(self) -> None:
        """Move the slider from where it is, or from the beginning, to the end."""
        self._button.label = "Pause"
        if self._slider.value >= self._last - STEP:
            self._slider.value = 0.0
        while self._playing.is_set() and self._slider.value < self._last:
            speed = float(self._speed.value.removesuffix("x"))
            self._slider.value = min(self._slider.value + speed * FRAME, self._last)
            time.sleep(FRAME)
        self._playing.clear()
        self._button.label = "Play"


def _line(leaf: LeafRun, t: float) -> Line:
    """The leaf's line at a time."""
    if t < leaf.start:
        return Line(leaf.label, 0, "INVALID")
    if t < leaf.end:
        return Line(leaf.label, 0, "RUNNING")
    return Line(leaf.label, 0, leaf.status, leaf.message)
