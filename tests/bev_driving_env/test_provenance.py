from __future__ import annotations

import json
import shlex
from importlib.metadata import version

from bev_driving_env import provenance as module
from bev_driving_env.provenance import git_commit, provenance


def test_provenance_names_command_seeds_versions_and_date():
    note = provenance(["run", "--out", "a folder"], [3, 4])
    assert shlex.split(note["command"]) == ["bev-bench", "run", "--out", "a folder"]
    assert note["seeds"] == [3, 4]
    assert note["versions"]["numpy"] == version("numpy")
    assert note["date_utc"].endswith("+00:00")
    assert json.loads(json.dumps(note)) == note


def test_an_installed_copy_inside_a_foreign_repository_has_no_commit(tmp_path, monkeypatch):
    module._git(tmp_path / "x", "init")
    copy = tmp_path / "provenance.py"
    copy.write_text("", encoding="utf-8")
    monkeypatch.setattr(module, "__file__", str(copy))
    assert git_commit() is None


def test_the_commit_of_a_tracked_file_is_found_and_marked_when_the_tree_has_changes(
    tmp_path, monkeypatch
):
    tracked = tmp_path / "provenance.py"
    tracked.write_text("1\n", encoding="utf-8")
    name = ("-c", "user.name=Toy", "-c", "user.email=toy@example.org")
    for arguments in (("init",), ("add", "."), (*name, "commit", "-m", "toy")):
        assert module._git(tracked, *arguments) is not None
    monkeypatch.setattr(module, "__file__", str(tracked))
    commit = git_commit()
    assert commit is not None
    assert len(commit) == 40
    tracked.write_text("2\n", encoding="utf-8")
    first = git_commit()
    assert first.startswith(commit + "+")
    tracked.write_text("3\n", encoding="utf-8")
    assert git_commit() not in (first, commit)
