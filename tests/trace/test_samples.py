"""Samples and traces: selecting, joining, looking back, and the cache of results that follow from them."""

from __future__ import annotations

import gc
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.estimation.evidence import once
from palpate.trace.recording import Context, Conversion, LeafRun, NominalHand, Recording
from palpate.trace.samples import FORCES, Samples, Trace

HAND = NominalHand(0.009, 0.15, 0.01, 1e-4)
WIDTHS = {
    "t": (),
    "q": (7,),
    "dq": (7,),
    "tau_ext": (7,),
    "wrench": (6,),
    "pose_world_tcp": (7,),
    "twist": (6,),
    "target_world_tcp": (7,),
    "width": (),
}


def samples(times: object) -> Samples:
    """Every signal of row i holds its time."""
    t = np.array(times, dtype=float)
    return Samples(
        **{
            name: np.broadcast_to(t.reshape(-1, *[1] * len(shape)), (len(t), *shape)).copy()
            for name, shape in WIDTHS.items()
        }
    )


def trace() -> Trace:
    early = Recording(FORCES, 1.0, 2.0, Context("still", holding="cup"))
    late = Recording(FORCES, 3.0, 4.0, Context("still"))
    leaves = (
        LeafRun("tree.children[0]", "MovePose", "MovePose(a)", 0.0, 1.0, "SUCCESS"),
        LeafRun("tree.children[1]", "MeasureForces", "MeasureForces()", 1.0, 2.0, "SUCCESS"),
        LeafRun("tree.children[2]", "MovePose", "MovePose(b)", 2.0, 3.0, "FAILURE", "blocked"),
    )
    return Trace(
        samples(np.arange(0, 5, 0.25)),
        leaves,
        (early, late),
        (Conversion("Force2Mass", "cup", "mass", early, 2.1),),
        HAND,
    )


def test_every_signal_has_its_shape() -> None:
    empty = Samples.empty()
    assert len(empty) == 0
    shapes = {f.name: getattr(empty, f.name).shape[1:] for f in fields(Samples)}
    assert shapes == WIDTHS | {"wrench_sensor": (0,)}


def test_a_wrench_sensor_has_columns_of_its_own() -> None:
    t = np.arange(3.0)
    sensed = replace(samples(t), wrench_sensor=np.outer(t, np.arange(6.0)))
    assert sensed.where(t > 1.0).wrench_sensor.tolist() == [[0, 2, 4, 6, 8, 10]]
    made = replace(trace(), samples=sensed)
    assert made.columns()["sensor_ty"].tolist() == [0, 4, 8]
    assert "sensor_ty" not in trace().columns()


def test_joining_keeps_the_order_and_skips_what_is_empty() -> None:
    joined = Samples.concatenate([samples([0, 1]), Samples.empty(), samples([2])])
    assert joined.t.tolist() == [0, 1, 2]
    assert joined.wrench[:, 5].tolist() == [0, 1, 2]
    assert len(Samples.concatenate([])) == 0


@given(
    st.lists(st.integers(0, 400), unique=True).map(sorted), st.integers(0, 400), st.integers(0, 400)
)
def test_between_is_every_row_from_start_to_end(ticks: list[int], start: int, end: int) -> None:
    found = samples([i * 0.005 for i in ticks]).between(start * 0.005, end * 0.005)
    assert np.round(found.t / 0.005).astype(int).tolist() == [i for i in ticks if start <= i <= end]
    assert found.q.shape == (len(found), 7)


def test_the_method_where_takes_masks_and_slices() -> None:
    rows = samples([0, 1, 2, 3])
    assert rows.where(rows.t > 1).t.tolist() == [2, 3]
    assert rows.where(slice(1, 3)).width.tolist() == [1, 2]


def test_a_recording_is_a_window_of_the_trace() -> None:
    made = trace()
    assert made.of(made.recordings[0]).t.tolist() == [1.0, 1.25, 1.5, 1.75, 2.0]


def test_leaves_are_selected_by_primitive_and_status() -> None:
    made = trace()
    assert [leaf.label for leaf in made.leaf_runs("MovePose")] == ["MovePose(a)"]
    assert [leaf.message for leaf in made.leaf_runs("MovePose", status="FAILURE")] == ["blocked"]
    assert len(made.leaf_runs("MovePose", "MeasureForces")) == 2


@pytest.mark.parametrize(
    ("time", "leaves", "recordings", "conversions"),
    [(0.5, 0, 0, 0), (2.0, 2, 1, 0), (2.1, 2, 1, 1), (9.0, 3, 2, 1)],
)
def test_a_trace_until_a_time_has_what_ended_by_then(
    time: float, leaves: int, recordings: int, conversions: int
) -> None:
    then = trace().until(time)
    assert (len(then.leaves), len(then.recordings), len(then.conversions)) == (
        leaves,
        recordings,
        conversions,
    )
    assert then.samples.t[-1] <= time
    assert then.hand is HAND


def test_a_cached_result_is_computed_once_for_each_samples_and_arguments() -> None:
    asked: list[tuple[Samples, float]] = []

    @once
    def times(samples: Samples, factor: float) -> np.ndarray:
        asked.append((samples, factor))
        return factor * np.ones(3)

    one, other = Samples.empty(), Samples.empty()
    assert times(one, 2.0) is times(one, 2.0)
    assert times(one, 3.0).tolist() == [3.0] * 3
    times(other, 2.0)
    assert asked == [(one, 2.0), (one, 3.0), (other, 2.0)]


def test_a_cached_array_is_read_only() -> None:
    @once
    def zeros(samples: Samples) -> np.ndarray:
        return np.zeros(len(samples) + 1)

    with pytest.raises(ValueError, match="read-only"):
        zeros(Samples.empty())[0] = 1.0


def test_a_cached_result_is_forgotten_with_its_samples() -> None:
    made: list[int] = []

    @once
    def count(samples: Samples) -> int:
        made.append(len(samples))
        return len(made)

    for _ in range(3):
        count(Samples.empty())
        gc.collect()
    assert len(made) == 3
