"""Mistakes of the person at the command line."""

from __future__ import annotations

from bev_driving_env.command_line import UsageError


class OtherRunError(UsageError):
    """The output folder holds results that do not belong to this run."""
