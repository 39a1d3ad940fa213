"""Tables in Parquet files: exact, and clear about files that are not sound."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from bev_driving_env.logs.errors import LogError
from bev_driving_env.logs.parquet import read_columns, read_metadata, write_table

COLUMNS = {
    "real": np.random.default_rng(0).normal(size=500),
    "action": np.linspace(-1, 1, 500).astype(np.float32),
    "count": np.arange(500, dtype=np.int32),
    "word": np.full(500, 2**61, np.int64),
    "change": np.random.default_rng(1).integers(0, 9, 500).astype(np.int32),
}
KINDS = {name: column.dtype for name, column in COLUMNS.items()}


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "folder" / "table.parquet"
    write_table(path, COLUMNS, "töwn", delta=("count", "word"))
    return path


def test_columns_and_metadata_come_back_bit_for_bit(path):
    found = read_columns(path, KINDS)
    for name, column in COLUMNS.items():
        assert found[name].dtype == column.dtype
        assert found[name].tobytes() == column.tobytes()
    assert read_metadata(path) == ("töwn", 500)


def test_a_table_without_rows_comes_back(tmp_path):
    write_table(tmp_path / "empty", {"a": np.zeros(0, np.int32)}, "", delta=("a",))
    assert read_columns(tmp_path / "empty", {"a": np.int32})["a"].shape == (0,)
    assert read_metadata(tmp_path / "empty")[1] == 0


def test_no_temporary_file_is_left(path):
    assert [entry.name for entry in path.parent.iterdir()] == ["table.parquet"]


def test_a_write_that_fails_half_way_leaves_the_old_file_as_it_was(path, monkeypatch):
    before = path.read_bytes()

    def disk_is_full(writer, table, **options):
        raise OSError("no space left")

    monkeypatch.setattr(pq.ParquetWriter, "write_table", disk_is_full)
    with pytest.raises(OSError, match="no space left"):
        write_table(path, {"a": np.zeros(2, np.int32)}, "")
    assert path.read_bytes() == before
    assert len(list(path.parent.iterdir())) == 1


@pytest.mark.parametrize("kept", [0, 3, 200, -10])
def test_a_truncated_file_is_named_with_the_cure(path, kept):
    path.write_bytes(path.read_bytes()[:kept])
    for read in (read_metadata, lambda at: read_columns(at, KINDS)):
        with pytest.raises(LogError, match=r"table\.parquet is truncated.*delete that file"):
            read(path)


def test_a_flipped_bit_in_the_data_is_noticed(path):
    content = bytearray(path.read_bytes())
    content[200] ^= 16
    path.write_bytes(bytes(content))
    with pytest.raises(LogError, match=r"table\.parquet"):
        read_columns(path, KINDS)


def test_a_foreign_table_is_told_from_a_log(tmp_path):
    path = tmp_path / "foreign.parquet"
    pq.write_table(pa.table({"a": pa.array(np.arange(3))}), path)
    with pytest.raises(LogError, match="not of a BEVTown drive log"):
        read_metadata(path)


def test_a_missing_column_or_another_type_is_an_error(path):
    with pytest.raises(LogError, match="no column 'speed'"):
        read_columns(path, {"speed": np.float64})
    with pytest.raises(LogError, match="'count' must be int64, got int32"):
        read_columns(path, {"count": np.int64})


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(LogError, match=r"nothing\.parquet is missing"):
        read_columns(tmp_path / "nothing.parquet", KINDS)
