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


def test_a_noted_signal_waits_to_be_heard() -> None:
    with interrupts() as signals, signals.defer():
        press()
        assert signals.pressed() == 1
        press()
        assert signals.pressed() == 2


def test_one_that_finds_the_last_one_unheard_is_raised() -> None:
    with interrupts() as signals, signals.defer():
        press()
        with pytest.raises(Interrupted):
            press()


def test_who_takes_them_first_takes_them_for_all() -> None:
    with interrupts() as outer, outer.defer(), interrupts() as inner, inner.defer():
        press()
        assert inner is outer
        assert outer.pressed() == 1


def test_those_from_before_are_not_counted() -> None:
    with interrupts() as signals:
        with signals.defer():
            press()
            assert signals.pressed() == 1
        with signals.defer():
            assert signals.pressed() == 0
