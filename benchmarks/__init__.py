"""Closed-loop benchmarks: suites, runner, results, tables, maps and the ``bev-bench`` command."""

from __future__ import annotations

# needs nothing but the standard library. Not loaded on first use, as elsewhere: importing a module
# of the same name later would put the module in the function's place
from .driving_score import driving_score

__all__ = ["driving_score"]
