from __future__ import annotations

import hashlib
import importlib
import json

import pytest

from benchmarks.errors import OtherRunError
from benchmarks.run_folder import KEPT, claim_folder, discard_run, open_run, used_hashes


def test_a_folder_of_the_same_run_is_resumed_and_one_of_another_refused(tmp_path):
    claim_folder(tmp_path, {"suite": "paper", "seed": [0]}, {})
    claim_folder(tmp_path, {"suite": "paper", "seed": [0]}, {})
    with pytest.raises(OtherRunError, match=r"suite 'paper', this one has 'routes'"):
        claim_folder(tmp_path, {"suite": "routes", "seed": [0]}, {})


@pytest.mark.parametrize("content", ['{"identity": ', "[]", "{}"])
def test_a_broken_run_file_is_named(tmp_path, content):
    (tmp_path / "run.json").write_text(content, encoding="utf-8")
    with pytest.raises(OtherRunError, match=r"run\.json is not the file of a run"):
        claim_folder(tmp_path, {"suite": "paper"}, {})


def test_episodes_of_unknown_origin_are_refused(tmp_path):
    (tmp_path / "episodes").mkdir()
    with pytest.raises(OtherRunError, match=r"no run\.json"):
        claim_folder(tmp_path, {"suite": "paper"}, {})


def test_a_run_with_another_file_of_the_same_name_is_not_resumed(tmp_path):
    options = {"suite": "paper"}

    def opened(content: str, *, overwrite: bool = False):
        driver = tmp_path / "driver.py"
        driver.write_text(content, encoding="utf-8")
        digest = {"driver:Driver": hashlib.sha256(driver.read_bytes()).hexdigest()}
        return open_run(tmp_path / "out", ["bench"], options, digest, [0], overwrite=overwrite)

    first = opened("brave = True")
    assert opened("brave = True")["hashes"] == first["hashes"]
    with pytest.raises(OtherRunError, match="hashes"):
        opened("brave = False")
    opened("brave = False", overwrite=True)
    kept = json.loads((tmp_path / "out" / "run.json").read_text(encoding="utf-8"))
    assert kept["identity"]["hashes"] != first["hashes"]


def test_only_a_runs_own_files_are_discarded(tmp_path):
    claim_folder(tmp_path, {}, {})
    for name in (*KEPT, "thesis"):
        (tmp_path / name).mkdir()
    discard_run(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis"]


def test_a_folder_that_is_no_runs_is_left_alone(tmp_path):
    (tmp_path / "episodes").mkdir()
    discard_run(tmp_path)
    assert (tmp_path / "episodes").is_dir()


def test_only_what_comes_from_a_file_has_a_hash(tmp_path, monkeypatch):
    source = "class Blank:\n    channels = ('road',)\n\n\nclass Driver:\n    pass\n"
    path = tmp_path / "toy_used.py"
    path.write_text(source, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.import_module("toy_used")
    hashes = used_hashes(
        ["expert", "toy_used:Driver"],
        ["ground_truth|route=toy_used:Blank", "toy_used:Blank~shift=0.5"],
        ["Town01"],
    )
    digest = hashlib.sha256(source.encode()).hexdigest()
    assert hashes == {"toy_used:Driver": digest, "toy_used:Blank": digest}
