"""What a log says about itself."""

import dataclasses
import json

import pytest

from bev_driving_env.logs.errors import LogError
from bev_driving_env.logs.header import EpisodeHeader, LogHeader, check_belongs

HEADER = LogHeader(
    town="Town01",
    settings={"traffic": {"vehicles": 3, "pedestrians": 4}, "appearance": "test"},
    control_hz=10,
    physics_hz=20,
    seed=5,
    levels=(0.0, 1.0),
    provenance={"command": "bev-agents collect"},
)
EPISODE = EpisodeHeader(
    episode_id="Town01/route/3",
    episode_seed=2**61 + 1,
    collection=1,
    collection_seed=9,
    route=3,
    level=0.1,
    lanes=(4, 5, 6),
    start_m=0.1 + 0.2,
    end_m=1 / 3,
    vehicle_sizes=((4.1, 1.9),),
    pedestrian_sizes=(),
    signals=24,
    outcome="success",
    infractions=({"name": "off_road", "time_s": 3.5},),
)


def test_a_log_header_comes_back(tmp_path):
    HEADER.write(tmp_path)
    read = LogHeader.read(tmp_path)
    assert read == HEADER
    assert read.provenance == HEADER.provenance
    assert read.env_settings.appearance == "test"


def test_an_episode_header_comes_back_to_the_last_bit(tmp_path):
    assert EpisodeHeader.from_text(EPISODE.as_text(), tmp_path) == EPISODE


def spoil(folder, **changes):
    """A header that was written by another program: its checksum says nothing."""
    HEADER.write(folder)
    path = folder / "log.json"
    values = json.loads(path.read_text(encoding="utf-8"))
    del values["crc32"]
    path.write_text(json.dumps({**values, **changes}), encoding="utf-8")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format_version": 99}, r"log\.json has format version 99.*pip install --upgrade"),
        ({"format": "other"}, r"log\.json is not of a BEVTown drive log"),
        ({"format_version": None}, "format version None"),
        ({"levels": 3}, r"log\.json is damaged"),
        ({"control_hz": 0}, "control_hz must be an int of at least 1, got 0"),
        ({"seed": float("inf")}, r"log\.json is damaged"),
        ({"settings": {"trafic": "dense"}}, "did you mean 'traffic'"),
    ],
)
def test_a_header_that_cannot_be_used_is_named_with_the_cure(tmp_path, changes, message):
    spoil(tmp_path, **changes)
    with pytest.raises(LogError, match=message):
        LogHeader.read(tmp_path)


def test_a_header_without_a_checksum_is_of_the_first_days_and_read(tmp_path):
    spoil(tmp_path)
    assert LogHeader.read(tmp_path) == HEADER


def test_a_digit_that_changed_is_noticed(tmp_path):
    HEADER.write(tmp_path)
    path = tmp_path / "log.json"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('"vehicles": 3', '"vehicles": 8'), encoding="utf-8")
    with pytest.raises(LogError, match=r"log\.json is damaged or was edited.*another folder"):
        LogHeader.read(tmp_path)
    text = EPISODE.as_text().replace("0.30000000000000004", "0.30000000000000104")
    with pytest.raises(LogError, match=r"a\.parquet is damaged or was edited.*deleting that file"):
        EpisodeHeader.from_text(text, tmp_path / "a.parquet")


BELONGING = dataclasses.replace(
    EPISODE,
    collection_seed=HEADER.collection_seed(1),
    level=1.0,
    vehicle_sizes=((4.1, 1.9),) * 3,
    pedestrian_sizes=((0.5, 0.5),) * 4,
)


def test_an_episode_of_the_log_belongs_to_it(tmp_path):
    check_belongs(HEADER, BELONGING, tmp_path / "collection_01_route_03.end", ".end")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"episode_id": "Town02/route/3"}, "town 'Town02' instead of 'Town01'"),
        ({"level": 0.5}, "level"),
        ({"collection_seed": 4}, "seed 4 instead of"),
        ({"pedestrian_sizes": ()}, r"traffic \(3, 0\) instead of \(3, 4\)"),
        ({"collection": 2}, "was written as collection_02_route_03"),
    ],
)
def test_an_episode_of_another_log_is_told_by_what_differs(tmp_path, changes, message):
    with pytest.raises(LogError, match=message):
        check_belongs(
            HEADER,
            dataclasses.replace(BELONGING, **changes),
            tmp_path / "collection_01_route_03.end",
            ".end",
        )


def test_half_a_header_and_none_are_named(tmp_path):
    with pytest.raises(LogError, match=r"no log\.json.*bev-agents collect"):
        LogHeader.read(tmp_path)
    (tmp_path / "log.json").write_text('{"format": "bev', encoding="utf-8")
    with pytest.raises(LogError, match=r"log\.json cannot be read"):
        LogHeader.read(tmp_path)


def test_an_episode_of_a_newer_version_is_named(tmp_path):
    text = EPISODE.as_text().replace('"format_version":1', '"format_version":2')
    with pytest.raises(LogError, match="format version 2, this BEVTown reads up to 1"):
        EpisodeHeader.from_text(text, tmp_path / "a.parquet")
