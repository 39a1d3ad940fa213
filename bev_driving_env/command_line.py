"""What the project's commands have in common: mistakes are told in one line, with status 2."""

from __future__ import annotations

import argparse
from typing import NoReturn


class UsageError(Exception):
    """Something the user can put right; reported in one line, exit status 2."""


class OneLineParser(argparse.ArgumentParser):
    """Reports a mistake in one line and exits with 2."""

    def error(self, message: str) -> NoReturn:
        """Exit with one line instead of the whole usage."""
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")
