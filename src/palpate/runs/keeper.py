"""Keeper of a growing run.

Its folder is complete after every stage. A failed stage costs only its own result.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from palpate.common.errors import InputError, PalpateError
from palpate.common.processes import Interrupts
from palpate.runs.folder import growing_folder, write_json, write_plan, write_trace, write_twin
from palpate.runs.result import result_json
from palpate.runs.run import TRACE, Run, Stage
from palpate.trace.mcap import GrowingRecorder, TraceStream
from palpate.trace.samples import Samples

Step = Callable[[Run], Iterator[Run]]  # Stage of a run: yields the grown run once or several times
# Message of a failed crash-safe trace. The finished trace is written all the same.
TRACE_FAILED = "the trace was not written down while it grew"
WRITING = 0.02  # Largest share of time spent on writing result.json while estimates are made


class Keeper:
    """Keeper of a run in `folder`, or in memory if that is None.

    A failed stage and an unwritable file each add a line to the run's `shortfalls`. So does a
    requested value that cannot be measured, or written into the twin. A signal ends the run after
    the present stage (`Run.interrupted`).
    """

    def __init__(self, folder: Path | None, signals: Interrupts) -> None:
        self.folder = folder
        self._signals = signals
        self._shortfalls: list[str] = []
        self._lost: dict[str, None] = {}
        self._stream: TraceStream | None = None
        self._due = 0.0
        self._ended: set[str] = set()

    def begin(self, run: Run, request: Mapping[str, Any]) -> Run:
        """Make the folder and write the files that exist before the execution. Raises InputError:
        it exists, or cannot be made or written."""
        # Write plan and request first: `finish` needs them after a crash.
        run = replace(run, stage="executing", folder=self.folder)
        if self.folder is None:
            return run
        growing_folder(self.folder)
        try:
            write_json(self.folder / "request.json", request)
            write_plan(run, self.folder)
            write_json(self.folder / "result.json", result_json(run, self.folder))
        except OSError as error:
            self._discard()
            raise InputError(f"cannot write '{self.folder}': {error.strerror}") from error
        return run

    def run_stage(self, stage: Stage, step: Step, run: Run) -> Run:
        """Carry out a stage; return the run with everything that it completed."""
        run = self.keep(replace(run, stage=stage))
        try:
            with self._signals.raise_in_block():
                for grown in step(run):
                    run = self.keep(grown, seldom=stage == "estimating")
        except KeyboardInterrupt:
            return self.keep(replace(run, interrupted=f"{self._signals.reason} while {stage}"))
        except Exception as error:
            self.note_shortfall(f"{stage} failed", error)
        return self.keep(run)

    def carry_out_execution(self, step: Step, run: Run) -> Run:
        """Carry out the execution, in which a signal asks for a controlled stop.
        Raises PalpateError: nothing could be executed; nothing has moved, and the folder is removed."""
        # Signals are deferred: the runner turns them into a controlled stop.
        with self._signals.defer():
            try:
                for grown in step(run):
                    run = self.keep(grown)
            except PalpateError:
                self._discard()
                raise
            except KeyboardInterrupt:
                return self.keep(
                    replace(run, interrupted=f"{self._signals.reason} while executing")
                )
            finally:
                self._close_stream()
            # A second signal, or one after the end of the motion, interrupts the run.
            pressed = self._signals.count_new()
            stopped = run.execution is not None and run.execution.status == "stopped"
            if pressed > 1 or (pressed and not stopped):
                run = replace(run, interrupted=f"{self._signals.reason} while executing")
            return self.keep(run)

    def keep(self, run: Run, seldom: bool = False) -> Run:
        """Add the shortfalls to the run and write result.json.

        The file grows with every estimate. With `seldom` it is not written if that would take more
        than a share `WRITING` of the time.
        """
        # Write undisturbed by signals, so that the folder always has a complete file.
        with self._signals.defer():
            run = self.with_shortfalls(run)
            if run.begun is not None:
                run = replace(run, total_seconds=time.perf_counter() - run.begun)
            began = time.perf_counter()
            if self.folder is not None and not (seldom and began < self._due):
                content = result_json(run, self.folder)
                self.try_writing("result.json", lambda at: write_json(at / "result.json", content))
                ended = time.perf_counter()
                self._due = ended + (ended - began) / WRITING
            return self.with_shortfalls(run)

    def follow(self, failure: str, step: Callable[[], object]) -> None:
        """Carry out a step of work during the execution.

        After an exception, `failure` is noted and this step is not carried out again. Other steps
        continue.
        """
        if failure in self._ended:
            return
        try:
            step()
        except Exception as error:
            self._ended.add(failure)
            self.note_shortfall(failure, error)

    def samples(self, samples: Samples, recorded: GrowingRecorder) -> None:
        """Append samples to the growing trace. Raises OSError: the disk is full or missing."""
        if self.folder is None:
            return
        # Open the file with the first samples.
        if self._stream is None:
            self._stream = TraceStream(self.folder / TRACE, recorded.hand, recorded.gravity)
        self._stream.write(samples, recorded)

    def trace(self, run: Run) -> None:
        """Write the finished trace over the growing one."""
        self._close_stream()
        self.try_writing(TRACE, lambda at: write_trace(run, at))

    def twin(self, run: Run) -> None:
        """Write the twin into the folder, and to `--twin` unless that file exists."""
        self.try_writing("twin.xml", lambda at: write_twin(run, at))
        # An existing file is never overwritten.
        twin, wanted = run.finished, run.settings.twin
        if twin is not None and wanted is not None and not wanted.exists():
            self.try_writing(str(wanted), lambda _: twin.save(wanted))

    def try_writing(self, name: str, write: Callable[[Path], object]) -> None:
        """Write into the folder; note a failure."""
        if self.folder is None:
            return
        try:
            write(self.folder)
            self._lost.pop(name, None)
        except Exception as error:
            self.note_shortfall(f"{name} was not written", error)
            # A full disk and a removed folder are no fault of the run, which has no file then.
            if isinstance(error, OSError):
                self._lost[name] = None

    def note_damage(self, name: str, error: Exception) -> None:
        """Note a file of the folder that is damaged."""
        self.note_shortfall(f"{name} is damaged, and nothing can be made from it", error)
        self._lost[name] = None

    def note_shortfall(self, stage: str, error: Exception) -> None:
        """Note a failure and its reason, once."""
        line = shortfall(stage, error)
        if line not in self._shortfalls:
            self._shortfalls.append(line)

    def with_shortfalls(self, run: Run) -> Run:
        """Add the shortfalls, and the files that were lost, to the run."""
        # Unmeasured and unwritten values first, then failures; each line once.
        of_values = [*map(str, run.plan.unmeasured), *run.unwritten]
        lines = dict.fromkeys([*run.shortfalls, *of_values, *self._shortfalls])
        return replace(run, shortfalls=tuple(lines), lost=tuple(self._lost))

    def _close_stream(self) -> None:
        stream, self._stream = self._stream, None
        if stream is not None:
            try:
                stream.close()
            except OSError as error:
                self.note_shortfall(TRACE_FAILED, error)

    def _discard(self) -> None:
        """Remove the folder of a run in which nothing has moved."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)


def shortfall(stage: str, error: Exception) -> str:
    """Format a failure and its reason in one line."""
    reason = getattr(error, "strerror", None) or f"{type(error).__name__}: {error}"
    return f"{stage}: {reason}".splitlines()[0]
