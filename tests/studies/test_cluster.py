"""Tasks on a Ray cluster of two nodes, on loopback: the same results as here."""

from __future__ import annotations

import os
import socket
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from palpate.common.errors import InputError, Unavailable
from palpate.runs.settings import Settings
from palpate.studies.accuracy import Question, SeedRun, StudyCase, accuracy, run_case, run_seed
from palpate.studies.workers import Processes, RayCrew, WorkerLost, crew

pytestmark = pytest.mark.long

NODES = ("127.0.0.2", "127.0.0.3")
"""Two places of this machine that nobody else reaches. Ray takes 127.0.0.1 for another one."""
MEMORY = 80_000_000
"""Bytes of a node's object store, near the least that Ray takes."""

needs_ray = pytest.mark.skipif(
    find_spec("ray") is None or sys.platform != "linux", reason="needs palpate[ray] on Linux"
)

SCENE = """<mujoco><worldbody>
  <site name="robot_base"/>
  <body name="table" pos="0.4 0 -0.02"><geom type="box" size=".5 .6 .02" friction="0.6 0.005 0.0001"/></body>
  <body name="cup" pos="0.5 0.1 0.05"><freejoint/>
    <geom type="box" size=".03 .02 .05" friction="0.5"{mass}/></body>
</worldbody></mujoco>"""


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """Of a cluster of two nodes with a processor each, without a dashboard, that tells nobody."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        utils: Any = pytest.importorskip("ray.cluster_utils")
        options: dict[str, Any] = {"num_cpus": 1, "object_store_memory": MEMORY}
        options |= {"include_dashboard": False}
        cluster = utils.Cluster(
            initialize_head=True, head_node_args=options | {"node_ip_address": NODES[0]}
        )
        try:
            cluster.add_node(**options, node_ip_address=NODES[1])
            yield cluster.address
        finally:
            cluster.shutdown()


def home(_: int) -> str:
    """Where a task is done."""
    import ray

    time.sleep(0.2)  # nobody does all of them
    return ray.util.get_node_ip_address()


def fatal(number: int) -> int:
    """Ends its process."""
    os._exit(number)


@needs_ray
def test_two_nodes_find_what_this_machine_finds(address: str, tmp_path: Path) -> None:
    for name, mass in {"scene": "", "world": ' mass="0.3"'}.items():
        (tmp_path / f"{name}.xml").write_text(SCENE.format(mass=mass), encoding="utf-8")
    settings = Settings(scene=tmp_path / "scene.xml", world=tmp_path / "world.xml", noise="lab")
    with crew(address) as workers:
        assert isinstance(workers, RayCrew)
        assert workers.room == 4  # two for each of two processors
        values = dict(workers.each(partial(run_seed, settings), [1, 2]))
        crash = dict(workers.each(run_case, [StudyCase(Question("no such scenario"), 7)]))[0]
        homes = dict(workers.each(by_value(home), range(6)))
        lost = dict(workers.each(by_value(fatal), [1]))[0]
    assert [values[0]] == accuracy(settings, [1])
    assert (values[1].seed, values[1].status) == (2, "complete")
    assert isinstance(crash, SeedRun)
    assert (crash.status, crash.seed) == ("crashed", 7)
    assert "no such scenario" in crash.crash
    assert set(homes.values()) == set(NODES)
    assert isinstance(lost, WorkerLost)


def by_value(function: Callable[[int], Any]) -> Callable[[int], Any]:
    """A function that workers need not import from here."""
    from ray import cloudpickle

    cloudpickle.register_pickle_by_value(sys.modules[function.__module__])
    return function


def test_this_machine_is_a_crew_without_any_cluster() -> None:
    with crew("local", 3) as workers:
        assert workers == Processes(3)


@pytest.mark.parametrize("address", ["somewhere", "http://host:1", "host", "a b:1"])
def test_an_address_has_a_form(address: str) -> None:
    with pytest.raises(InputError, match="local, auto, HOST:PORT, ray://HOST:PORT"), crew(address):
        pass


def test_a_cluster_that_does_not_answer_is_unavailable_at_once() -> None:
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        place = f"127.0.0.1:{nobody.getsockname()[1]}"
        with pytest.raises(Unavailable, match=f"no Ray cluster at '{place}'"), crew(place):
            pass


def test_a_missing_ray_gets_an_install_hint(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(Unavailable, match=r"pip install 'palpate\[ray\]'"), crew("auto"):
        pass
