"""A run in the browser, as it happens: the cell in 3-D, the tree with statuses, forces, a stop button, and,
before a real robot moves, the plan and whether it may. When all is done the run can be played again.

The page is served by viser, on this machine alone, at a secret address (`live.access`). Text from
elsewhere (a plan's explanation, names, messages) is escaped: viser's markdown would render HTML in it.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import redirect_stdout
from io import StringIO

import numpy as np
import viser
from viser import uplot

from palpate.errors import Unavailable
from palpate.execution.leaf import PrimitiveLeaf
from palpate.execution.runner import Snapshot
from palpate.live.access import Access
from palpate.live.markup import Line, note, outline, preformatted
from palpate.live.nodes import step_of, steps_of, walk
from palpate.live.player import Player
from palpate.live.shapes import Drawn
from palpate.pictures.posed import PosedCell
from palpate.runs.run import Run
from palpate.scene.scene import Scene

HOST = "127.0.0.1"
REFRESH_PERIOD = 1 / 15
"""s of wall time between two pictures."""
HISTORY = 1500
"""Ticks of force that the plot shows: half a minute."""
NARROW = 0.8
"""Width over height of a view below which a screen is taken for a phone's."""
ASK_PERIOD = 0.2
"""s: how often a signal is looked for while a person is asked."""


class LivePage:
    """The page. A context manager and an `Observer`.

    Args:
        port: where it is served; another one is taken where it is not free.

    Raises:
        Unavailable: no port is free.
    """

    def __init__(self, port: int = 8080) -> None:
        self._access = Access()
        try:
            with _unheard(), self._access.controls():
                self._server = viser.ViserServer(HOST, port, label="palpate", verbose=False)
        except OSError as error:
            raise Unavailable(f"the live page cannot be served: {error}") from None
        if not self._access.applied:
            self._server.stop()
            raise Unavailable(f"the live page cannot be guarded with viser {viser.__version__}")
        # sharing would put a page that lets a robot move on the internet
        self._server.gui.configure_theme(show_logo=False, show_share_button=False)
        self._server.gui.main_panel.dock_right()
        self._server.on_client_connect(_fit_phone)
        self._server.scene.set_up_direction("+z")
        self._server.initial_camera.position = (1.6, -1.4, 1.2)
        self._server.initial_camera.look_at = (0.4, 0.0, 0.3)
        self._stage = self._server.gui.add_html(note("waiting"))
        self._stop = self._server.gui.add_button("Stop", color="red", visible=False)
        self._stop.on_click(lambda _: os.kill(os.getpid(), signal.SIGINT))
        self._force = _force_plot(self._server.gui)
        self._tree = self._server.gui.add_html("")
        self._closed = False
        self._cell: PosedCell | None = None
        self._drawn: Drawn | None = None
        self._painted = -np.inf
        self._times: deque[float] = deque(maxlen=HISTORY)
        self._forces: deque[float] = deque(maxlen=HISTORY)

    def __enter__(self) -> LivePage:
        return self

    def __exit__(self, *_: object) -> None:
        with _unheard():
            self._server.stop()

    @property
    def url(self) -> str:
        """Address of the page, with the token that it is served to."""
        return f"http://{HOST}:{self._server.get_port()}{self._access.path}"

    @property
    def closed(self) -> bool:
        """True if somebody has closed it, at the page."""
        return self._closed

    def progress(self, stage: str) -> None:
        """Name the present stage of the work."""
        self._stop.visible = False
        self._say(f"{stage} …")

    def confirm(self, run: Run) -> bool:
        """Show the plan and wait for the person at the page to let the robot move, or not."""
        self._show_scene(run.scene)
        self._say("May the robot move?", run.plan.explanation)
        self._tree.content = preformatted(str(run.plan.tree))
        answered = threading.Event()
        allowed = self._server.gui.add_button("Let it move", color="teal", order=0.5)
        refused = self._server.gui.add_button("Do not", order=0.6)
        said: list[bool] = []

        def answer(event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            said.append(event.target is allowed)
            answered.set()

        allowed.on_click(answer)
        refused.on_click(answer)
        try:
            while not answered.wait(ASK_PERIOD):  # a signal is raised between two waits
                pass
        finally:
            allowed.remove()
            refused.remove()
        return said[0]

    def on_tick(self, snapshot: Snapshot) -> None:
        """Take note of a tick; draws at most fifteen times a second."""
        self._times.append(snapshot.elapsed)
        self._forces.append(float(snapshot.robot.wrench[2]))
        if time.monotonic() - self._painted < REFRESH_PERIOD:
            return
        self._painted = time.monotonic()
        self._paint(snapshot)

    def finished(self, run: Run) -> None:
        """Let the run be played again."""
        self._stop.visible = False
        self._say(run.status, *(repr(estimate).strip("<>") for estimate in run.estimates))
        done = self._server.gui.add_button("Close", order=0.7)
        done.on_click(lambda _: self._close())
        if run.trace_if_any is None or not len(run.trace_if_any.t):
            return
        self._show_scene(run.scene)
        assert self._cell is not None
        assert self._drawn is not None
        self._plot(run.trace_if_any.t - run.trace_if_any.t[0], run.trace_if_any.wrench[:, 2])
        Player(self._server.gui, run.trace_if_any, self._cell, self._drawn, self._tree)

    def _close(self) -> None:
        self._closed = True

    def _paint(self, snapshot: Snapshot) -> None:
        state = snapshot.robot
        leaf = steps_of(snapshot)[0]
        with self._server.atomic():
            self._show_scene(leaf.blackboard.scene)
            assert self._cell is not None
            assert self._drawn is not None
            holding = leaf.blackboard.state.holding
            self._cell.show(state.q, state.width, state.pose_world_tcp, holding)
            self._drawn.move(self._cell.data)
            self._plot(np.array(self._times), np.array(self._forces))
            self._tree.content = outline(_lines(snapshot))
            self._stop.visible = True
            self._say(*_headline(snapshot))

    def _show_scene(self, scene: Scene) -> None:
        if self._cell is None:
            self._cell = PosedCell(scene)
            self._drawn = Drawn(self._server.scene, self._cell.model)
            arm = scene.arm
            self._cell.show(arm.home, arm.hand.opening, scene.pose_world_base, None)
            self._drawn.move(self._cell.data)

    def _plot(self, times: np.ndarray, forces: np.ndarray) -> None:
        step = max(1, len(times) // HISTORY)
        self._force.data = (times[::step].astype(float), forces[::step].astype(float))

    def _say(self, headline: str, *lines: str) -> None:
        self._stage.content = note(headline, *lines)


def _unheard() -> redirect_stdout[StringIO]:
    """viser greets on stdout, where results are expected."""
    return redirect_stdout(StringIO())


def _fit_phone(client: viser.ClientHandle) -> None:
    """On a narrow screen the panel covers the lower part: put the cell into the upper one."""
    if client.camera.aspect < NARROW:
        client.camera.position = (2.0, -1.7, 1.1)
        client.camera.look_at = (0.35, 0.0, -0.35)


def _force_plot(gui: viser.GuiApi) -> viser.GuiUplotHandle:
    nothing = np.zeros(1)
    return gui.add_uplot(
        (nothing, nothing),
        (uplot.Series(label="s"), uplot.Series(label="F_z / N", stroke="#0b8f83", width=2)),
        scales={"x": uplot.Scale(time=False)},
        title="vertical force",
        aspect=2.0,
    )


def _headline(snapshot: Snapshot) -> Iterator[str]:
    step, steps = step_of(snapshot)
    yield f"step {step} of {steps}"
    yield f"{snapshot.elapsed:.1f} s · F_z {float(snapshot.robot.wrench[2]):.1f} N"
    if snapshot.stopping:
        yield f"stopping: {snapshot.stopping}"


def _lines(snapshot: Snapshot) -> Iterator[Line]:
    said = {leaf.node: leaf.message for leaf in snapshot.leaves}
    for node, depth in walk(snapshot.root):
        message = said.get(node.node, "") if isinstance(node, PrimitiveLeaf) else ""
        yield Line(node.name, depth, node.status.value, message)
