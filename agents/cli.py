"""The ``bev-agents`` command."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence

from bev_driving_env.command_line import OneLineParser, UsageError
from bev_driving_env.logs.errors import LogError

from . import collect_command, info_command, train_command


def build_parser() -> argparse.ArgumentParser:
    """The parser with one verb per command."""
    parser = OneLineParser(
        prog="bev-agents", description="Demonstrations of driving, and drivers made from them."
    )
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="COMMAND")
    collect_command.add_parser(verbs)
    info_command.add_parser(verbs)
    train_command.add_parser(verbs)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: Arguments without the program's name; those of the process if None.

    Returns:
        Exit status: 0 done, 2 a mistake in the arguments or a log that cannot be read,
        130 interrupted.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    # a polite kill takes the same way out as Ctrl-C
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    options = build_parser().parse_args(arguments)
    try:
        return int(options.command(options, arguments))
    except (UsageError, LogError, OSError) as error:
        print(f"bev-agents {options.verb}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"\nbev-agents {options.verb}: interrupted{options.interrupted}", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
