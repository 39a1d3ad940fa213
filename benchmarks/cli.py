"""The ``bev-bench`` command."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence

from bev_driving_env.command_line import OneLineParser, UsageError

from . import play_command, run_command, speed_command, traffic_command


def build_parser() -> argparse.ArgumentParser:
    """The parser with one verb per command."""
    parser = OneLineParser(
        prog="bev-bench", description="Closed-loop benchmarks of bird's-eye-view predictors."
    )
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="COMMAND")
    run_command.add_parser(verbs)
    play_command.add_parser(verbs)
    speed_command.add_parser(verbs)
    traffic_command.add_parser(verbs)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: Arguments without the program's name; those of the process if None.

    Returns:
        Exit status: 0 done, 1 an agent failed, 2 a mistake in the arguments, 130 interrupted.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    # so that "module:factory" finds a module in the current folder, as "python -m" would
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    # a polite kill takes the same way out as Ctrl-C
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    parser = build_parser()
    options = parser.parse_args(arguments)
    try:
        return int(options.command(options, arguments))
    except (UsageError, OSError) as error:
        print(f"bev-bench {options.verb}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        hint = options.interrupted
        print(f"\nbev-bench {options.verb}: interrupted{hint}", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
