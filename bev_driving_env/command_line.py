"""What the project's commands have in common: mistakes are told in one line, with status 2."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Iterable, Sequence
from types import FrameType
from typing import Any, NoReturn, Protocol

from .logs.errors import LogError


class UsageError(Exception):
    """Something the user can put right; reported in one line, exit status 2."""


class Terminated(KeyboardInterrupt):
    """SIGTERM, which ends a command in the same orderly way as Ctrl-C, with another status."""


def raise_terminated(_: int, __: FrameType | None) -> NoReturn:
    """Handler of SIGTERM."""
    raise Terminated


class OneLineParser(argparse.ArgumentParser):
    """Reports a mistake in one line and exits with 2."""

    def error(self, message: str) -> NoReturn:
        """Exit with one line instead of the whole usage."""
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")


class Command(Protocol):
    """A module of one verb."""

    def add_parser(self, verbs: Any) -> None:
        """Add the verb to a parser's subparsers."""


def verbs_parser(prog: str, about: str, commands: Iterable[Command]) -> OneLineParser:
    """The parser of a program with one verb for each command.

    Args:
        prog: The program's name.
        about: What it is for.
        commands: What adds the verbs, in this order.
    """
    parser = OneLineParser(prog=prog, description=about)
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="COMMAND")
    for command in commands:
        command.add_parser(verbs)
    return parser


def run_verb(parser: argparse.ArgumentParser, argv: Sequence[str] | None = None) -> int:
    """Run the verb that the arguments name.

    Args:
        parser: Its verbs have set ``command``, called with the parsed and the raw arguments, and
            ``interrupted``, what to say after an interruption.
        argv: Arguments without the program's name; those of the process if None.

    Returns:
        Exit status: the command's, 2 for a mistake in the arguments, a file or a drive log that
        cannot be read or written, 130 after Ctrl-C, 143 after SIGTERM.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    # so that "module:factory" finds a module in the current folder, as "python -m" would
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    signal.signal(signal.SIGTERM, raise_terminated)
    options = parser.parse_args(arguments)
    try:
        return int(options.command(options, arguments))
    except (UsageError, OSError, LogError) as error:
        print(f"{parser.prog} {options.verb}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as stop:
        print(f"\n{parser.prog} {options.verb}: interrupted{options.interrupted}", file=sys.stderr)
        return 128 + (signal.SIGTERM if isinstance(stop, Terminated) else signal.SIGINT)
