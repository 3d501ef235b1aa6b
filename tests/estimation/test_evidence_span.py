"""Evidence of one object in a long run with many."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest

from palpate.estimation.evidence import AROUND, find_evidence_span, select_evidence
from palpate.trace.recording import Context, Conversion, LeafRun, Recording
from palpate.trace.samples import Trace

EACH = 15.0
NAMES = [f"box_{i}" for i in range(1, 9)]


def recording(start: float, holding: str | None) -> Recording:
    return Recording("gripper_forces", start, start + 1.0, Context("still", holding=holding))


@pytest.fixture
def long(trace: Trace) -> Trace:
    """Eight boxes are in the hand for 8 s each, one every 15 s."""
    t = np.arange(0.0, EACH * len(NAMES), 0.1)
    rows = trace.samples.where(np.zeros(len(t), dtype=np.intp))  # pyright: ignore[reportArgumentType]
    leaves: list[LeafRun] = []
    for i, name in enumerate(NAMES):
        for first, last, held in ((2.0, 4.0, name), (4.0, 10.0, name), (10.0, 12.0, None)):
            start, end = EACH * i + first, EACH * i + last
            after = Context("still", holding=held)
            leaves.append(LeafRun("tree", "Any", "any", start, end, "SUCCESS", context=after))
    recordings = tuple(recording(EACH * i + 5.0, name) for i, name in enumerate(NAMES))
    conversions = tuple(
        Conversion("Force2Mass", name, "mass", one, one.end)
        for name, one in zip(NAMES, recordings, strict=True)
    )
    return replace(
        trace,
        samples=replace(rows, t=t),
        leaves=tuple(leaves),
        recordings=recordings,
        conversions=conversions,
    )


def test_evidence_of_an_object_is_limited_to_its_own_time(long: Trace) -> None:
    near = select_evidence(long, "box_4")
    assert near.t[0] == pytest.approx(47.0 - AROUND)
    assert near.t[-1] == pytest.approx(55.0 + AROUND)
    assert "box_4" in {one.context.holding for one in near.recordings}
    assert len(near.recordings) < len(long.recordings)
    assert select_evidence(near, "box_4") is near
    assert select_evidence(long, "box_4") is near, "found once, with what is found in it"


def test_later_samples_change_no_estimate(long: Trace) -> None:
    """So that it can be estimated while the next is measured."""
    whole, sofar = select_evidence(long, "box_2"), select_evidence(long.until(95.0), "box_2")
    assert sofar.leaves == whole.leaves
    assert sofar.recordings == whole.recordings
    assert np.array_equal(sofar.t, whole.t)


def test_neighbouring_recordings_of_the_empty_hand_belong_to_an_object(long: Trace) -> None:
    empty = recording(140.0, None)
    turned = replace(
        long,
        recordings=(*long.recordings[:4], recording(48.0, None), *long.recordings[4:], empty),
    )
    reached, before = find_evidence_span(turned, "box_8"), find_evidence_span(long, "box_8")
    assert reached is not None
    assert before is not None
    assert reached[1] == empty.end + AROUND > before[1]
    assert find_evidence_span(turned, "box_2") == find_evidence_span(long, "box_2")


def test_every_recording_may_be_evidence_of_an_object_never_held(long: Trace) -> None:
    assert select_evidence(long, "table") is long


@pytest.mark.parametrize("name", ["box_4", "table"])
def test_a_trace_lives_no_longer_than_its_run(long: Trace, name: str) -> None:
    """What is cached of a trace does not refer to it."""
    own = replace(long)
    select_evidence(own, name)
    alive = weakref.ref(own)
    del own
    gc.collect()
    assert alive() is None
