"""Live page: a run in the browser, with the cell in 3-D, the tree with statuses, forces, and a stop
button.

Before a real robot moves, the page shows the plan and asks for confirmation. A finished run can be
played again.

viser serves the page, on this machine only, at a secret address (`live_shapes.Access`). Text from
elsewhere (a plan's explanation, names, messages) is escaped: viser's markdown would render HTML in
it.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections import deque
from contextlib import redirect_stdout
from io import StringIO

import numpy as np
import viser
from viser import uplot

from palpate.common.errors import Unavailable
from palpate.execution.leaf import PrimitiveLeaf
from palpate.execution.runner import Snapshot
from palpate.perception.posed import PosedCell, Replay
from palpate.runs.report.console import TreeLine, note, outline, to_html
from palpate.runs.report.live_shapes import Access, DrawnBodies
from palpate.runs.report.live_terminal import step_of, steps_of, walk
from palpate.runs.run import Run
from palpate.scene.scene import Scene
from palpate.trace.samples import Trace

HOST = "127.0.0.1"
REFRESH_PERIOD = 1 / 15  # s of wall time between two pictures
HISTORY = 1500  # Ticks of force in the plot: half a minute
NARROW = 0.8  # Ratio of width to height of a view below which the screen is a phone's
ASK_PERIOD = 0.2  # s between two polls for a signal while a person is asked
STEP = 0.05  # s: step of the slider
FRAME = 1 / 20  # s of wall time between two pictures of a playback
SPEEDS = ("1x", "4x", "16x")


class LivePage:
    """The page. A context manager and an `Observer`.

    Args:
        port: to serve it at; another one is taken if it is not free.

    Attributes:
        closed: a person has closed it, at the page.

    Raises:
        Unavailable: no port is free.
    """

    def __init__(self, port: int = 8080) -> None:
        # Serve the page; without the access controls it is stopped at once.
        self._access = Access()
        try:
            with redirect_stdout(StringIO()), self._access.controls():  # viser prints a greeting
                self._server = viser.ViserServer(HOST, port, label="palpate", verbose=False)
        except OSError as error:
            raise Unavailable(f"the live page cannot be served: {error}") from None
        # Never serve without the access controls.
        if not self._access.applied:
            self._server.stop()
            raise Unavailable(f"the live page cannot be guarded with viser {viser.__version__}")
        # Disable sharing: it would put a page that lets a robot move on the internet.
        self._server.gui.configure_theme(show_logo=False, show_share_button=False)
        self._server.gui.main_panel.dock_right()
        self._server.on_client_connect(_fit_phone)
        self._server.scene.set_up_direction("+z")
        self._server.initial_camera.position = (1.6, -1.4, 1.2)
        self._server.initial_camera.look_at = (0.4, 0.0, 0.3)
        # Elements of the page: stage, stop button, force plot, tree.
        self._stage = self._server.gui.add_html(note("waiting"))
        self._stop = self._server.gui.add_button("Stop", color="red", visible=False)
        self._stop.on_click(lambda _: os.kill(os.getpid(), signal.SIGINT))
        nothing = np.zeros(1)
        self._force = self._server.gui.add_uplot(
            (nothing, nothing),
            (uplot.Series(label="s"), uplot.Series(label="F_z / N", stroke="#0b8f83", width=2)),
            scales={"x": uplot.Scale(time=False)},
            title="vertical force",
            aspect=2.0,
        )
        self._tree = self._server.gui.add_html("")
        self.closed = False
        self._shown: tuple[PosedCell, DrawnBodies] | None = None
        self._painted = -np.inf
        self._times: deque[float] = deque(maxlen=HISTORY)
        self._forces: deque[float] = deque(maxlen=HISTORY)

    def __enter__(self) -> LivePage:
        return self

    def __exit__(self, *_: object) -> None:
        with redirect_stdout(StringIO()):
            self._server.stop()

    @property
    def url(self) -> str:
        """Address of the page, with the token that it is served to."""
        return f"http://{HOST}:{self._server.get_port()}{self._access.path}"

    def progress(self, stage: str) -> None:
        """Show the name of the present stage."""
        self._stop.visible = False
        self._say(f"{stage} …")

    def show_plan(self, run: Run) -> None:
        """Show the plan while it is rehearsed."""
        self._show_scene(run.scene)
        self._say("This is the plan; it is being rehearsed …", run.plan.explanation)
        self._tree.content = to_html(str(run.plan.tree))

    def confirm(self, run: Run) -> bool:
        """Ask the person at the page whether the robot may move."""
        self._say("May the robot move?", str(run.rehearsal or ""), run.plan.explanation)
        # Two buttons set the answer from the server's thread.
        answered = threading.Event()
        allowed = self._server.gui.add_button("Let it move", color="teal", order=0.5)
        refused = self._server.gui.add_button("Do not", order=0.6)
        answers: list[bool] = []

        def answer(event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            answers.append(event.target is allowed)
            answered.set()

        allowed.on_click(answer)
        refused.on_click(answer)
        try:
            while not answered.wait(ASK_PERIOD):  # a signal is raised between two waits
                pass
        finally:
            allowed.remove()
            refused.remove()
        return answers[0]

    def on_tick(self, snapshot: Snapshot) -> None:
        """Record a tick; draw at most fifteen times a second."""
        self._times.append(snapshot.elapsed)
        self._forces.append(float(snapshot.robot.wrench[2]))
        if time.monotonic() - self._painted < REFRESH_PERIOD:
            return
        self._painted = time.monotonic()
        self._paint(snapshot)

    def offer_playback(self, run: Run) -> None:
        """Offer the run for playback."""
        self._stop.visible = False
        self._say(run.status, *(repr(estimate).strip("<>") for estimate in run.estimates))

        def close(_: object) -> None:
            self.closed = True

        self._server.gui.add_button("Close", order=0.7).on_click(close)
        trace = run.trace_if_any
        if trace is not None and len(trace.t):
            cell, drawn = self._show_scene(run.scene)
            self._plot(trace.t - trace.t[0], trace.wrench[:, 2])
            _Player(self._server.gui, self._tree, trace, cell, drawn)

    def _paint(self, snapshot: Snapshot) -> None:
        state, blackboard = snapshot.robot, steps_of(snapshot)[0].blackboard
        step, steps = step_of(snapshot)
        # Headline: step, time and force.
        headline = [
            f"step {step} of {steps}",
            f"{snapshot.elapsed:.1f} s · F_z {float(state.wrench[2]):.1f} N",
        ]
        if snapshot.stopping:
            headline.append(f"stopping: {snapshot.stopping}")
        # Tree: one line a node, with the messages of the leaves.
        messages = {leaf.node: leaf.message for leaf in snapshot.leaves}
        lines: list[TreeLine] = []
        for node, depth in walk(snapshot.root):
            message = messages.get(node.node, "") if isinstance(node, PrimitiveLeaf) else ""
            lines.append(TreeLine(node.name, depth, node.status.value, message))
        # Change all elements in one message, so that the page never mixes two ticks.
        with self._server.atomic():
            cell, drawn = self._show_scene(blackboard.scene)
            cell.show(state.q, state.width, state.pose_world_tcp, blackboard.state.holding)
            drawn.move(cell.data)
            self._plot(np.array(self._times), np.array(self._forces))
            self._tree.content = outline(lines)
            self._stop.visible = True
            self._say(*headline)

    def _show_scene(self, scene: Scene) -> tuple[PosedCell, DrawnBodies]:
        """Return the cell and its bodies in the view; the first call makes them."""
        if self._shown is None:
            cell, arm = PosedCell(scene), scene.arm
            drawn = DrawnBodies(self._server.scene, cell.model)
            cell.show(arm.home, arm.hand.opening, scene.pose_world_base, None)
            drawn.move(cell.data)
            self._shown = cell, drawn
        return self._shown

    def _plot(self, times: np.ndarray, forces: np.ndarray) -> None:
        # Thin out long series to the size of the plot.
        step = max(1, len(times) // HISTORY)
        self._force.data = (times[::step].astype(float), forces[::step].astype(float))

    def _say(self, headline: str, *lines: str) -> None:
        self._stage.content = note(headline, *lines)


def _fit_phone(client: viser.ClientHandle) -> None:
    """Adapt the view to a narrow screen: the panel covers the lower part, so the cell moves into the upper one."""
    if client.camera.aspect < NARROW:
        client.camera.position = (2.0, -1.7, 1.1)
        client.camera.look_at = (0.35, 0.0, -0.35)


class _Player:
    """Playback of a finished run: a slider over its time, and a button that plays it."""

    def __init__(
        self,
        gui: viser.GuiApi,
        tree: viser.GuiHtmlHandle,
        trace: Trace,
        cell: PosedCell,
        drawn: DrawnBodies,
    ) -> None:
        self._tree, self._trace, self._cell, self._drawn = tree, trace, cell, drawn
        # Pose the cell by the trace; the slider has the time since its beginning.
        self._replay = Replay(cell, trace)
        self._last = max(float(trace.t[-1] - trace.t[0]), STEP)
        self._playing = threading.Event()
        self._button = gui.add_button("Play", order=0.4)
        self._button.on_click(lambda _: self._toggle())
        self._speed = gui.add_dropdown("speed", SPEEDS, initial_value="4x", order=0.45)
        self._slider = gui.add_slider("time / s", 0.0, self._last, STEP, self._last, order=0.5)
        self._slider.on_update(lambda _: self._show(float(self._slider.value)))
        self._show(self._last)

    def _show(self, seconds: float) -> None:
        """Show cell and tree at a time after the beginning, s."""
        # Pose the cell, then show the status of each leaf at that time.
        t = float(self._trace.t[0]) + seconds
        self._replay.show(t)
        self._drawn.move(self._cell.data)
        lines: list[TreeLine] = []
        for leaf in self._trace.leaves:
            if t < leaf.end:
                lines.append(TreeLine(leaf.label, 0, "INVALID" if t < leaf.start else "RUNNING"))
            else:
                lines.append(TreeLine(leaf.label, 0, leaf.status, leaf.message))
        self._tree.content = outline(lines)

    def _toggle(self) -> None:
        if self._playing.is_set():
            self._playing.clear()
            return
        self._playing.set()
        threading.Thread(target=self._play, name="playback", daemon=True).start()

    def _play(self) -> None:
        """Move the slider from its position to the end; at the end, begin again."""
        self._button.label = "Pause"
        if self._slider.value >= self._last - STEP:
            self._slider.value = 0.0
        while self._playing.is_set() and self._slider.value < self._last:
            speed = float(self._speed.value.removesuffix("x"))
            self._slider.value = min(self._slider.value + speed * FRAME, self._last)
            time.sleep(FRAME)
        self._playing.clear()
        self._button.label = "Play"
