"""`--live`: without its library, and the button that stops the arm."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from browser import needs_chromium, opened
from typer.testing import CliRunner

from palpate.cli.app import app
from palpate.trace.mcap import read_mcap


def test_a_missing_viser_gets_an_install_hint(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("palpate.runs.report.live_p")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "viser", None)
    done = CliRunner().invoke(app, ["demo", "one_missing_mass", "--live"])
    assert done.exit_code == 5
    assert "pip install 'palpate[live]'" in done.stderr


def test_removed_option_is_an_error() -> None:
    done = CliRunner().invoke(app, ["demo", "one_missing_mass", "--groot"])
    assert done.exit_code == 2
    assert "No such option: --groot" in done.stderr


@pytest.mark.long
@needs_chromium
def test_the_stop_button_stops_the_arm(tmp_path: Path) -> None:
    """As Ctrl-C does: what is held is put down, what was measured is kept."""
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "palpate", "demo", "one_missing_mass", "--live", "--json"),
            *("--out", str(tmp_path / "run")),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "MUJOCO_GL": "disable"},
    )
    assert process.stderr is not None
    url = process.stderr.readline().split()[-1]
    with opened(url, tmp_path / "browser") as seen:
        seen.click("Stop")
        out, err = process.communicate(timeout=60)
    assert process.returncode == 4
    assert "stopped: interrupted; what there is" in err.splitlines()[-1]
    document = json.loads(out)
    assert document == json.loads((tmp_path / "run" / "result.json").read_text("utf-8"))
    assert document["status"] == "aborted"
    trace = read_mcap(tmp_path / "run" / "trace.mcap")
    held = [leaf.context.holding for leaf in trace.leaves if leaf.context]
    assert held[-1] is None, "nothing is left in the hand"
    assert (tmp_path / "run" / "report.html").exists()
