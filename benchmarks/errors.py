"""Mistakes of the person at the command line."""

from __future__ import annotations


class UsageError(Exception):
    """Something the user can put right; reported in one line, exit status 2."""


class OtherRunError(UsageError):
    """The output folder holds results that do not belong to this run."""
