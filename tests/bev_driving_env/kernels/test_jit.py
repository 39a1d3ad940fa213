from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numba
import pytest

from bev_driving_env.kernels import jit
from bev_driving_env.kernels.jit import announce_compilation, drop_stale_caches, kernel


@pytest.fixture
def kernels_folder(tmp_path, monkeypatch):
    (tmp_path / "__pycache__").mkdir()
    (tmp_path / "jit.py").write_text("", encoding="utf-8")
    monkeypatch.setattr(jit, "__file__", str(tmp_path / "jit.py"))
    return tmp_path


def test_caches_older_than_any_kernel_are_dropped_and_newer_ones_kept(kernels_folder):
    (kernels_folder / "callee.py").write_text("", encoding="utf-8")
    old = kernels_folder / "__pycache__" / "caller-1.py311.nbi"
    new = kernels_folder / "__pycache__" / "caller-2.py311.nbi"
    for path, age_s in ((old, 100.0), (new, -100.0)):
        path.write_bytes(b"")
        os.utime(path, (time.time() - age_s, time.time() - age_s))
    drop_stale_caches()
    assert not old.exists()
    assert new.exists()


def test_compilation_is_announced_only_when_it_takes_long(capsys):
    with announce_compilation(patience_s=30.0):
        pass
    assert capsys.readouterr().err == ""
    with announce_compilation(patience_s=0.01):
        time.sleep(0.2)
    assert "compiling" in capsys.readouterr().err


def test_a_kernel_works_where_nothing_can_be_cached(monkeypatch):
    real = numba.njit

    def refuse(*, cache: bool = False, **options: object):
        if cache:
            raise RuntimeError("cannot cache function: no locator available")
        return real(**options)

    monkeypatch.setattr(numba, "njit", refuse)

    def double(x: float) -> float:
        return 2.0 * x

    assert kernel(double)(3.0) == 6.0


def test_first_use_says_so_and_the_next_process_finds_the_cache(tmp_path):
    code = (
        "from bev_driving_env.kernels.dynamics import braked\n"
        "from bev_driving_env.kernels.jit import announce_compilation\n"
        "with announce_compilation(0.0): braked(1.0, 2.0, 40.0, 0.05)\n"
        "print(sum(braked.stats.cache_hits.values()), sum(braked.stats.cache_misses.values()))"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    runs = [
        subprocess.run(
            [sys.executable, "-c", code],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        for _ in range(2)
    ]
    assert [run.stdout.split() for run in runs] == [["0", "1"], ["1", "0"]]
    assert "compiling" in runs[0].stderr


def test_a_cache_that_another_process_drops_at_the_same_time_does_no_harm(tmp_path, monkeypatch):
    (tmp_path / "__pycache__").mkdir()
    (tmp_path / "kernel.py").write_text("")
    caches = [tmp_path / "__pycache__" / f"{name}.nbi" for name in "ab"]
    for cache in caches:
        cache.write_text("")
        os.utime(cache, (0, 0))
    monkeypatch.setattr(jit, "__file__", str(tmp_path / "jit.py"))
    unlink = Path.unlink

    def unlink_all(path, missing_ok=False):
        for cache in caches:  # the other process is faster
            unlink(cache, missing_ok=True)

    monkeypatch.setattr(Path, "unlink", unlink_all)
    jit.drop_stale_caches()
    assert not any(cache.exists() for cache in caches)
