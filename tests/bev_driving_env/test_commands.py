from __future__ import annotations

import subprocess
import sys

import pytest

from bev_driving_env.commands import foreign_packages

BENCH = "import sys; sys.argv = ['bev-bench', '--help']; "
BENCH += "from bev_driving_env.commands import bench; sys.exit(bench())"


def test_in_a_sound_installation_nothing_is_in_the_way():
    assert foreign_packages() == {}


@pytest.mark.parametrize("name", ["agents", "perception", "benchmarks"])
def test_a_foreign_package_in_the_way_is_named_with_its_path(name, tmp_path):
    (tmp_path / name).mkdir()
    (tmp_path / name / "__init__.py").write_text("", encoding="utf-8")
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); {BENCH}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert repr(name) in line
    assert str(tmp_path / name) in line
    assert "virtual environment" in line


@pytest.mark.parametrize("name", ["bench", "agents", "perception"])
def test_without_one_the_command_runs(name):
    code = BENCH.replace("bev-bench", f"bev-{name}").replace("bench()", f"{name}()")
    code = code.replace("import bench", f"import {name}")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert f"bev-{name}" in done.stdout
