"""`--live` and `--groot` where their libraries are not installed."""

import sys

import pytest
from typer.testing import CliRunner

from palpate.cli.app import app


def test_without_viser_it_is_said_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("palpate.live.p")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "viser", None)
    done = CliRunner().invoke(app, ["demo", "one_missing_mass", "--live"])
    assert done.exit_code == 5
    assert "pip install 'palpate[live]'" in done.stderr


def test_without_pyzmq_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "zmq", None)
    done = CliRunner().invoke(app, ["demo", "one_missing_mass", "--groot"])
    assert done.exit_code == 5
    assert "pip install 'palpate[groot]'" in done.stderr
