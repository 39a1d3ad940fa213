"""What can be wrong with a drive log."""

from __future__ import annotations


class LogError(ValueError):
    """A drive log cannot be read or written; the message names the file and the cure."""
