"""The ``bev-agents`` command."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from bev_driving_env.command_line import run_verb, verbs_parser

from . import collect_command, export_command, info_command, ppo_command, train_command

COMMANDS = (collect_command, info_command, export_command, train_command, ppo_command)


def build_parser() -> argparse.ArgumentParser:
    """The parser with one verb per command."""
    about = "Demonstrations of driving, and drivers made from them."
    return verbs_parser("bev-agents", about, COMMANDS)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; see :func:`bev_driving_env.command_line.run_verb`."""
    return run_verb(build_parser(), argv)


if __name__ == "__main__":
    sys.exit(main())
