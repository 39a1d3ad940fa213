"""The ``bev-bench`` command."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from bev_driving_env.command_line import OneLineParser, run_verb

from . import (
    attribute_command,
    play_command,
    report_command,
    run_command,
    speed_command,
    study_command,
    traffic_command,
)


def build_parser() -> argparse.ArgumentParser:
    """The parser with one verb per command."""
    parser = OneLineParser(
        prog="bev-bench", description="Closed-loop benchmarks of bird's-eye-view predictors."
    )
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="COMMAND")
    run_command.add_parser(verbs)
    report_command.add_parser(verbs)
    attribute_command.add_parser(verbs)
    study_command.add_parser(verbs)
    play_command.add_parser(verbs)
    speed_command.add_parser(verbs)
    traffic_command.add_parser(verbs)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: Arguments without the program's name; those of the process if None.

    Returns:
        Exit status: 0 done, 1 an agent failed, 2 a mistake in the arguments, 130 after
        Ctrl-C, 143 after SIGTERM.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    return run_verb(build_parser(), arguments)


if __name__ == "__main__":
    sys.exit(main())
