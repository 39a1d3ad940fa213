"""Entry points of the command line, which explain themselves when a foreign package is in the way.

``agents``, ``perception`` and ``benchmarks`` are names that other distributions use too (CARLA's
``PythonAPI`` and openai-agents both bring an ``agents``). Whichever Python finds first wins.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path

SIBLINGS = ("agents", "perception", "benchmarks")


def foreign_packages() -> dict[str, str]:
    """Sibling packages that Python would import from elsewhere: name to what it finds there."""
    home = Path(__file__).resolve().parent.parent
    foreign = {}
    for name in SIBLINGS:
        spec = importlib.util.find_spec(name)
        found = (
            None
            if spec is None
            else spec.origin or next(iter(spec.submodule_search_locations or ()), None)
        )
        if found is None:
            foreign[name] = "nothing"
        elif Path(found).resolve() not in (home / name, home / name / "__init__.py"):
            foreign[name] = found
    return foreign


def bench() -> int:
    """``bev-bench``."""
    return _run("bev-bench", "benchmarks.cli")


def agents() -> int:
    """``bev-agents``."""
    return _run("bev-agents", "agents.cli")


def perception() -> int:
    """``bev-perception``."""
    return _run("bev-perception", "perception.cli")


def _run(program: str, module: str) -> int:
    for name, found in foreign_packages().items():
        print(
            f"{program}: needs BEVTown's own package {name!r}, but Python finds {found}; "
            f"use a virtual environment of its own, or take that folder off PYTHONPATH",
            file=sys.stderr,
        )
        return 2
    main = importlib.import_module(module).main
    return int(main())
