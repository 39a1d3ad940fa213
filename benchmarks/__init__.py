"""Closed-loop benchmarks: suites, runner, results, tables, maps and the ``bev-bench`` command."""
