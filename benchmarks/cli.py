"""The ``bev-bench`` command."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from bev_driving_env.command_line import run_verb, verbs_parser

from . import (
    attribute_command,
    play_command,
    report_command,
    run_command,
    speed_command,
    study_command,
    traffic_command,
)

COMMANDS = (
    run_command,
    report_command,
    attribute_command,
    study_command,
    play_command,
    speed_command,
    traffic_command,
)


def build_parser() -> argparse.ArgumentParser:
    """The parser with one verb per command."""
    about = "Closed-loop benchmarks of bird's-eye-view predictors."
    return verbs_parser("bev-bench", about, COMMANDS)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; see :func:`bev_driving_env.command_line.run_verb`."""
    return run_verb(build_parser(), argv)


if __name__ == "__main__":
    sys.exit(main())
