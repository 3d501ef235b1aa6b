"""A film that is drawn while the arm moves, by a copy of this process."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import Pipe, parent_process
from typing import TYPE_CHECKING

import numpy as np

from palpate.beside import Beside, can_copy
from palpate.pictures.film import Film, Footage, Frame, Shot, captions, film_of, filmed
from palpate.pictures.renderer import Painter, gl_available
from palpate.trace.samples import Samples, Trace

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    from palpate.trace.recording import LeafRun

Chunk = list[Frame]
"""Frames to be drawn next; an empty one is the last."""


class Reel:
    """A film in the making. A context manager; leaving it gives up what is not finished.

    A film that fails is given up, too: it is to be made anew at the end, where a failure costs the film alone.
    """

    def __init__(
        self, footage: Callable[[], Footage | None], planned: Callable[[], Shot | None]
    ) -> None:
        """Begin once the shot that is `planned` is known; `footage`: as far as the camera has seen."""
        self._footage, self._planned = footage, planned
        self._shot: Shot | None = None
        self._copy: Beside[Film | None] | None = None
        self._sink: Connection | None = None
        self._whole: tuple[Footage, Trace] | None = None
        self._samples: list[Samples] = []
        self._ended: list[LeafRun] = []
        self._leaves = self._sent = 0
        self._failed = False

    def look(self, samples: Samples, leaves: Sequence[LeafRun]) -> None:
        """After a leaf has ended, have drawn what the camera saw before it; `samples` since the last call, and all
        `leaves` of this attempt that have ended."""
        if not self._failed:
            with self._failing():
                self._look(samples, leaves)

    def finish(self, footage: Footage, trace: Trace) -> Beside[Film | None] | None:
        """The film of the whole execution, in progress; None where it has to be made anew."""
        with self._failing():
            self._finish(footage, trace)
        return self._copy

    def __enter__(self) -> Reel:
        return self

    def __exit__(self, *_: object) -> None:
        self._give_up()

    @contextmanager
    def _failing(self) -> Generator[None]:
        """Give the film up after an exception of the block."""
        try:
            yield
        except Exception:
            self._failed = True
            self._give_up()

    def _give_up(self) -> None:
        if self._copy is not None:
            self._copy.close()
        if self._sink is not None:
            self._sink.close()
        self._copy = self._sink = None

    def _look(self, samples: Samples, leaves: Sequence[LeafRun]) -> None:
        self._samples.append(samples)
        if len(leaves) < self._leaves:  # a further attempt
            self._leaves = 0
        ended, self._leaves = leaves[self._leaves :], len(leaves)
        self._ended += ended
        if not ended or len(self._ended) < 2:
            return
        footage = self._footage() if self._copy or self._may_begin() else None
        if footage is None or self._shot is None:
            return
        felt, until = Samples.concatenate(self._samples), self._ended[-2].end
        # Of leaves that run side by side the last one may not have ended.
        chunk = self._chunk(self._shot, footage, felt, self._ended, until)
        self._samples = [felt.where(felt.t >= until)]
        if self._copy is None:
            self._begin(self._shot, footage, chunk)
        elif chunk:
            self._send(chunk)

    def _finish(self, footage: Footage, trace: Trace) -> None:
        if self._copy is None or self._shot is None:
            return
        if not self._shot.serves(Shot.of(footage)):
            self._give_up()
            return
        self._whole = footage, trace
        self._send(self._chunk(self._shot, footage, trace.samples, trace.leaves))
        self._send([])

    def _may_begin(self) -> bool:
        """True if the shot is known, and a copy of this process can draw it."""
        if Painter.used or not can_copy():
            return False
        self._shot = self._planned()
        return self._shot is not None and gl_available()[0]

    def _chunk(
        self,
        shot: Shot,
        footage: Footage,
        felt: Samples,
        leaves: Sequence[LeafRun],
        until: float = np.inf,
    ) -> Chunk:
        """Frames to be drawn next, up to robot time `until`, s."""
        frames = [footage.frames[row] for row in shot.rows(footage)[self._sent :]]
        frames = [frame for frame in frames if frame[0] <= until]
        self._sent += len(frames)
        said = captions(leaves, felt, [t for t, _ in frames])
        return [(qpos, caption) for (_, qpos), caption in zip(frames, said, strict=True)]

    def _begin(self, shot: Shot, footage: Footage, chunk: Chunk) -> None:
        source, sink = Pipe(duplex=False)

        def work() -> Film | None:
            if parent_process() is None:  # the copy has failed
                return None if self._whole is None else film_of(*self._whole)
            sink.close()  # the end of the original process then ends the source, too
            return filmed(footage, shot, _received(source, chunk))

        self._copy, self._sink = Beside(work), sink
        source.close()

    def _send(self, chunk: Chunk) -> None:
        assert self._sink is not None
        with suppress(OSError):  # the copy has failed
            self._sink.send(chunk)


def _received(source: Connection, chunk: Chunk) -> Iterator[Frame]:
    """Frames of a chunk and of those that come from `source` meanwhile, which is read at once."""
    waiting, is_open = deque(chunk), True
    while is_open or waiting:
        while is_open and source.poll(0.0 if waiting else None):
            more: Chunk = source.recv()
            waiting.extend(more)
            is_open = bool(more)
        if waiting:
            yield waiting.popleft()
