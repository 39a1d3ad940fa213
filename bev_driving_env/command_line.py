"""What the project's commands have in common: mistakes are told in one line, with status 2."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from types import FrameType
from typing import NoReturn


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


def run_verb(
    parser: argparse.ArgumentParser,
    arguments: Sequence[str],
    mistakes: tuple[type[Exception], ...] = (),
) -> int:
    """Run the verb that the arguments name.

    Args:
        parser: Its verbs have set ``command``, called with the parsed and the raw arguments, and
            ``interrupted``, what to say after an interruption.
        arguments: Arguments without the program's name.
        mistakes: What is reported in one line, besides ``UsageError`` and ``OSError``.

    Returns:
        Exit status: the command's, 2 for a mistake, 130 after Ctrl-C, 143 after SIGTERM.
    """
    # so that "module:factory" finds a module in the current folder, as "python -m" would
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    signal.signal(signal.SIGTERM, raise_terminated)
    options = parser.parse_args(arguments)
    told: tuple[type[Exception], ...] = (UsageError, OSError, *mistakes)
    try:
        return int(options.command(options, arguments))
    except told as error:
        print(f"{parser.prog} {options.verb}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as stop:
        print(f"\n{parser.prog} {options.verb}: interrupted{options.interrupted}", file=sys.stderr)
        return 128 + (signal.SIGTERM if isinstance(stop, Terminated) else signal.SIGINT)
