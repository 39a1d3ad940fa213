"""A log of short drives, sound or to be spoilt."""

import shutil

import pytest

from .short_drives import record_log


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    """Folder of a log in dense traffic, and what was seen live, by sample."""
    folder = tmp_path_factory.mktemp("recorded")
    return folder, record_log(folder, "train")


@pytest.fixture
def copied(recorded, tmp_path):
    """A copy of that log that may be spoilt."""
    return shutil.copytree(recorded[0], tmp_path / "copied")
