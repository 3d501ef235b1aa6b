"""Dynamics of an arm from a recording of it, in one call."""

from __future__ import annotations

from pathlib import Path

from palpate.api.given import contents_of, known_keywords
from palpate.estimation.arm.dynamics import ArmDynamics as InnerDynamics
from palpate.estimation.arm.dynamics import identify
from palpate.robots.registry import DEFAULT, load_description
from palpate.trace.log import ArmLog


class ArmDynamics(InnerDynamics):
    """Dynamics of an arm that can be written into its MJCF."""

    def save(self, path: str | Path) -> tuple[Path, ...]:
        """Write the arm's MJCF with the identified friction, damping, armature and inertias to `path`.

        Returns:
            Every file written, `path` first.

        Raises:
            InputError: it exists, or cannot be written.
        """
        from palpate.twin.arm import save_arm

        return save_arm(self, Path(path))


@known_keywords
def dynamics(
    log: str | Path | ArmLog,
    arm: str | Path = DEFAULT,
    *,
    hand: float | None = None,
    columns: str | Path | None = None,
) -> ArmDynamics:
    """Identify the dynamics of an arm from a recording of its free motion.

    Args:
        log: CSV, NPZ, MCAP, rosbag2 or Parquet with time, joint positions and torques; or a recording at hand.
        arm: name of the arm, or folder of its description.
        hand: kg of all that is mounted on the flange; 0 is a bare flange; None: to be found.
        columns: YAML that maps the log's columns to signals.

    Raises:
        InputError: a file that cannot be read, no such arm, too short a recording, or no joint moves.
    """
    from palpate.logs.reading import log_of

    log = log_of(log, columns)
    found = identify(log, load_description(str(arm)), hand)
    return ArmDynamics(**contents_of(found, InnerDynamics))
