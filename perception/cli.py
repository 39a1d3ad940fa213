"""The ``bev-perception`` command."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from bev_driving_env.command_line import OneLineParser, run_verb
from bev_driving_env.logs.errors import LogError

from . import evaluate_command, train_command


def build_parser() -> argparse.ArgumentParser:
    """The parser with one verb per command."""
    parser = OneLineParser(
        prog="bev-perception", description="Networks that see the bird's-eye view in camera images."
    )
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="COMMAND")
    train_command.add_parser(verbs)
    evaluate_command.add_parser(verbs)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: Arguments without the program's name; those of the process if None.

    Returns:
        Exit status: 0 done, 2 a mistake in the arguments or a log that cannot be read,
        130 after Ctrl-C,
        143 after SIGTERM.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    return run_verb(build_parser(), arguments, (LogError,))


if __name__ == "__main__":
    sys.exit(main())
