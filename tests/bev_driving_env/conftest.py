"""Towns that several test files drive in."""

import os
import subprocess
import sys

import pytest

from bev_driving_env.towns.build import build_grid_town
from bev_driving_env.towns.compiled import compile_network
from bev_driving_env.towns.grid import GridTown
from bev_driving_env.towns.registry import compiled_town


@pytest.fixture(params=["Town01", "Town02"], scope="session")
def town(request):
    """Each of CARLA's towns in turn."""
    return compiled_town(request.param)


@pytest.fixture(scope="session")
def ring():
    """A two-way ring road 200 m by 60 m around (100, 30): no junction, four corners of 10 m.

    Its northern side runs along y = 0; traffic heading east keeps to y = +2.
    """
    table = GridTown(
        columns={"A": 0.0, "B": 200.0},
        rows={"1": 0.0, "2": 60.0},
        links="A1-B1 B1-B2 A2-B2 A1-A2",
        junctions="",
        corners="A1 10  B1 10  B2 10  A2 10",
    )
    return compile_network("ring", build_grid_town(table))


@pytest.fixture(scope="session")
def ladder():
    """A ring 100 m by 40 m with a rung at x = 50: two T junctions, B1 and B2."""
    table = GridTown(
        columns={"A": 0.0, "B": 50.0, "C": 100.0},
        rows={"1": 0.0, "2": 40.0},
        links="A1-B1 B1-C1 A2-B2 B2-C2 A1-A2 B1-B2 C1-C2",
        junctions="""
            B1 8  E 10 62,-4  S 10 54,12  W 10 38,4
            B2 8  N 10 46,28  E 10 62,36  W 10 38,44
        """,
        corners="A1 9  C1 9  C2 9  A2 9",
    )
    return compile_network("ladder", build_grid_town(table))


@pytest.fixture(scope="session")
def printed_elsewhere():
    """Runs a file as a script in a process with other hashes; returns the words it prints."""

    def run(path):
        done = subprocess.run(
            [sys.executable, path],
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONHASHSEED": "5"},
            timeout=120,
            check=True,
        )
        return done.stdout.split()

    return run
