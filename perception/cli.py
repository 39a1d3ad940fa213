"""The ``bev-perception`` command."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from bev_driving_env.command_line import run_verb, verbs_parser

from . import evaluate_command, train_command


def build_parser() -> argparse.ArgumentParser:
    """The parser with one verb per command."""
    about = "Networks that see the bird's-eye view in camera images."
    return verbs_parser("bev-perception", about, (train_command, evaluate_command))


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; see :func:`bev_driving_env.command_line.run_verb`."""
    return run_verb(build_parser(), argv)


if __name__ == "__main__":
    sys.exit(main())
