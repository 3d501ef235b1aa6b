"""Real robots are reached through the driver of their URL's scheme."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from palpate.common.errors import InputError, Unavailable
from palpate.execution.cell import Driver
from palpate.execution.cell_drivers import Drivers, drivers
from palpate.scene.load import parse_scene

EMPTY = parse_scene("<mujoco><worldbody/></mujoco>")
FAKE = """from palpate.execution.cell_drivers import Driver

driver = Driver("fake", lambda url, scene: (url, scene))
"""


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder with an installed package that has one entry point, as an installer leaves it."""
    metadata = tmp_path / "fake_arm-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: fake-arm\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("[palpate.cells]\nfake = fake_arm_driver\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "fake_arm_driver", raising=False)
    drivers.cache_clear()
    yield tmp_path
    drivers.cache_clear()


def test_a_robot_that_is_not_there_is_unavailable() -> None:
    with pytest.raises(Unavailable, match="no driver for 'franka://host'"):
        drivers().connect("franka://host", EMPTY)


def test_an_installed_package_serves_its_scheme(site: Path) -> None:
    (site / "fake_arm_driver.py").write_text(FAKE)
    assert drivers().connect("fake://bench", EMPTY) == ("fake://bench", EMPTY)


def test_a_driver_that_cannot_be_loaded_is_named(site: Path) -> None:
    (site / "fake_arm_driver.py").write_text("import no_such_module")
    with pytest.raises(InputError, match=r"'fake' .* cannot be loaded: ModuleNotFoundError"):
        drivers()


def test_drivers_are_a_value_that_can_be_handed_over() -> None:
    mine = Drivers({"x": Driver("x", lambda url, scene: (url, scene))})  # type: ignore[arg-type]
    assert mine.connect("x://1", EMPTY) == ("x://1", EMPTY)
