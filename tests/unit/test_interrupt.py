"""Ctrl-C and SIGTERM: held back to the next step, or at once; afterwards handled as before."""

from __future__ import annotations

import signal

import pytest

from facetcam.cli.interrupt import SIGNALS, Stopped, stoppable, stopped_at_once


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_waits_for_the_next_step(number: int) -> None:
    before = signal.getsignal(number)
    steps = []
    with pytest.raises(Stopped) as caught, stoppable() as stop_if_asked:
        signal.raise_signal(number)
        steps.append("done")
        stop_if_asked()
    assert steps == ["done"]
    assert caught.value.exit_code == 128 + number
    assert signal.getsignal(number) is before


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_strikes_at_once(number: int) -> None:
    before = signal.getsignal(number)
    steps: list[str] = []
    with pytest.raises(Stopped) as caught, stopped_at_once():
        signal.raise_signal(number)
        steps.append("done")
    assert not steps
    assert caught.value.exit_code == 128 + number
    assert signal.getsignal(number) is before
