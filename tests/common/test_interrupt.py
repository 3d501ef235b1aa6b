"""Signals are raised where they come, or noted where something has to be brought to an end first."""

from __future__ import annotations

import os
import signal

import pytest

from palpate.common.processes import Interrupted, interrupts


def press(number: signal.Signals = signal.SIGINT) -> None:
    os.kill(os.getpid(), number)


def test_a_signal_is_raised_where_it_comes() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with interrupts((signal.SIGINT, signal.SIGTERM)):
        with pytest.raises(Interrupted, match=r"^interrupted$"):
            press()
        with pytest.raises(KeyboardInterrupt, match="interrupted by SIGTERM"):
            press(signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) is before


def test_signals_in_a_deferring_block_are_counted() -> None:
    with interrupts() as signals, signals.defer():
        press()
        assert signals.count_new() == 1
        press()
        assert signals.count_new() == 2


def test_a_second_unhandled_signal_is_raised() -> None:
    with interrupts() as signals, signals.defer():
        press()
        with pytest.raises(Interrupted):
            press()


def test_nested_blocks_count_signals_together() -> None:
    with interrupts() as outer, outer.defer(), interrupts() as inner, inner.defer():
        press()
        assert inner is outer
        assert outer.count_new() == 1


def test_earlier_signals_are_not_counted() -> None:
    with interrupts() as signals:
        with signals.defer():
            press()
            assert signals.count_new() == 1
        with signals.defer():
            assert signals.count_new() == 0
