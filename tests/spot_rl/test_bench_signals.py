"""Ctrl-C ends a bench whose runs take signals for their operator's; a signal that a fault raises does not."""

from __future__ import annotations

import signal

import pytest

from proof.faulty import ending_the_bench, raise_as_fault
from spot_runtime.session.signals import StopSignals
from spot_runtime.stops import StopReason


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT])
def test_a_signal_of_a_fault_stops_the_run_alone(number: signal.Signals) -> None:
    with ending_the_bench(), StopSignals() as signals:
        raise_as_fault(number)
        assert signals.take() is not None


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_from_outside_stops_the_run_and_then_the_bench(number: signal.Signals) -> None:
    reasons = []

    def bench() -> None:
        with ending_the_bench(), StopSignals() as signals:
            raise_as_fault(number)
            signal.raise_signal(number)
            stop = signals.take()
            reasons.append(None if stop is None else stop.reason)

    with pytest.raises((KeyboardInterrupt, SystemExit)) as ended:
        bench()
    assert reasons == [StopReason.OPERATOR_DAMP]
    assert ended.value.args == (() if number == signal.SIGINT else (128 + number,))
