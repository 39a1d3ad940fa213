"""Whose an output folder is."""

import pytest

from bev_driving_env.training.folder import (
    RECIPE,
    claim_folder,
    discard_training,
    holds_training,
)

FILES = ("weights.bin", "metrics.csv")


def test_a_claim_holds_for_the_same_recipe_alone(tmp_path):
    folder = tmp_path / "new"
    claim_folder(folder, {"data": ["a"]}, FILES)
    assert holds_training(folder)
    claim_folder(folder, {"data": ["a"]}, FILES)
    with pytest.raises(ValueError, match=r"data \['a'\], this one has \['b'\]: choose another"):
        claim_folder(folder, {"data": ["b"]}, FILES)


def test_files_of_another_origin_are_not_claimed_or_discarded(tmp_path):
    (tmp_path / "weights.bin").write_bytes(b"of somebody")
    discard_training(tmp_path, FILES)
    with pytest.raises(ValueError, match=r"holds weights\.bin but no training\.json"):
        claim_folder(tmp_path, {}, FILES)
    assert not holds_training(tmp_path)
    assert (tmp_path / "weights.bin").exists()


def test_only_what_training_wrote_is_discarded(tmp_path):
    claim_folder(tmp_path, {}, FILES)
    for name in (*FILES, "mine.txt", "events.out.tfevents.1"):
        (tmp_path / name).touch()
    discard_training(tmp_path, FILES)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


@pytest.mark.parametrize("text", ["{", "3", "null"])
def test_a_spoilt_claim_is_named(text, tmp_path):
    (tmp_path / RECIPE).write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match="is not the file of a training"):
        claim_folder(tmp_path, {}, FILES)
