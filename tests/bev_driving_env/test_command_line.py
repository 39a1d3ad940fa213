from __future__ import annotations

import os
import signal

import pytest

from bev_driving_env.command_line import OneLineParser, UsageError, run_verb


def status_of(command) -> int:
    """Exit status of a program whose only verb does this."""
    parser = OneLineParser(prog="toy")
    verb = parser.add_subparsers(dest="verb").add_parser("work")
    verb.set_defaults(command=command, interrupted="; all is kept")
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


def test_a_mistake_is_told_in_one_line(capsys):
    def command(options, arguments):
        raise UsageError("no such road")

    assert status_of(command) == 2
    assert capsys.readouterr().err == "toy work: no such road\n"
