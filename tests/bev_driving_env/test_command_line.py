from __future__ import annotations

import os
import signal

import pytest

from bev_driving_env.command_line import UsageError, run_verb, verbs_parser
from bev_driving_env.logs.errors import LogError


def status_of(command) -> int:
    """Exit status of a program whose only verb does this."""

    class Work:
        @staticmethod
        def add_parser(verbs):
            verbs.add_parser("work").set_defaults(command=command, interrupted="; all is kept")

    parser = verbs_parser("toy", "A toy.", [Work])
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    # who runs the tests in the background may have Ctrl-C ignored
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return run_verb(parser, ["work"])
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_ctrl_c_and_a_polite_kill_end_in_order_each_with_its_status(number, status, capsys):
    tidied = []

    def command(options, arguments):
        try:
            os.kill(os.getpid(), number)
        finally:
            tidied.append(True)

    assert status_of(command) == status
    assert tidied
    assert capsys.readouterr().err.strip() == "toy work: interrupted; all is kept"


@pytest.mark.parametrize("kind", [UsageError, OSError, LogError])
def test_a_mistake_is_told_in_one_line(kind, capsys):
    def command(options, arguments):
        raise kind("no such road")

    assert status_of(command) == 2
    assert capsys.readouterr().err == "toy work: no such road\n"
