"""Ctrl-C between two steps."""

import os
import signal
import threading

import pytest

from bev_driving_env.command_line import Terminated
from bev_driving_env.training.interrupts import noted_interrupts


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_is_noted_and_a_second_one_stops_at_once(number):
    before = signal.getsignal(number)
    with noted_interrupts() as flag:
        assert not flag.is_set()
        os.kill(os.getpid(), number)
        assert flag.is_set()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), number)
    assert signal.getsignal(number) is before


def test_another_thread_leaves_signals_alone():
    seen = []

    def work():
        with noted_interrupts() as flag:
            seen.append((flag.is_set(), signal.getsignal(signal.SIGINT)))

    before = signal.getsignal(signal.SIGINT)
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [(False, before)]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_what_stops_training_tells_a_polite_kill_from_ctrl_c(number):
    def train():
        with noted_interrupts() as flag:
            os.kill(os.getpid(), number)
            if flag.is_set():
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stopped:
        train()
    assert isinstance(stopped.value, Terminated) == (number == signal.SIGTERM)
