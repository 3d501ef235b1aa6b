"""Noise of an arm from a recording of it, in one call."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.api.given import known_keywords
from palpate.files.write import write_new
from palpate.logs.figure import Figure
from palpate.logs.noise_model import noise_file, stated
from palpate.logs.statistics import LogStatistics, statistics
from palpate.robots.description import RobotDescription
from palpate.robots.registry import DEFAULT, load_description
from palpate.trace.log import ArmLog

BESIDE = ("measured", "hardware", "datasheet", "lab")


@dataclass(frozen=True, slots=True, eq=False)
class ArmNoise:
    """Errors of an arm's joint signals, as a recording of free motion shows them.

    Attributes:
        source: name of the recording.
        seconds: its length.
        found: figures of each joint.
        notes: what was repaired when it was read.
    """

    source: str
    seconds: float
    found: LogStatistics
    arm: RobotDescription
    notes: tuple[str, ...] = ()

    @property
    def figures(self) -> dict[str, Figure]:
        """Figures of each joint, by name."""
        return self.found.figures()

    @property
    def models(self) -> dict[str, dict[str, list[float]]]:
        """Figures that palpate's own noise models state, by the model's name."""
        return {
            name: {key: values.tolist() for key, values in stated(name, self.arm).items()}
            for name in BESIDE
        }

    def record(self) -> dict[str, Any]:
        """Return all figures and those of the models beside them, for JSON."""
        figures = {
            name: {
                part: [None if x != x else x for x in getattr(figure, part).tolist()]
                for part in ("value", "low", "high")
            }
            for name, figure in self.figures.items()
        }
        head = {"log": self.source, "seconds": self.seconds, "notes": list(self.notes)}
        return head | {"figures": figures, "models": self.models}

    def save(self, path: str | Path) -> Path:
        """Write a noise model with these figures, for `noise=FILE.yaml`.

        Raises:
            InputError: the file exists, or cannot be written.
        """
        path = Path(path)
        text = noise_file(self.found, self.arm, path.stem, self.seconds)
        write_new(path, text)
        return path


@known_keywords
def noise(
    log: str | Path | ArmLog, arm: str | Path = DEFAULT, *, columns: str | Path | None = None
) -> ArmNoise:
    """Measure the errors of an arm's joint signals in a recording of its free motion.

    Args:
        log: CSV, NPZ, MCAP, rosbag2 or Parquet with time, joint positions and torques; or a recording at hand.
        arm: name of the arm, or folder of its description.
        columns: YAML that maps the log's columns to signals.

    Raises:
        InputError: a file that cannot be read, no such arm, or too short a recording.
    """
    from palpate.logs.reading import log_of

    log = log_of(log, columns)
    described = load_description(str(arm))
    found = statistics(log, described)
    return ArmNoise(log.source, float(log.t[-1] - log.t[0]), found, described, log.notes)
