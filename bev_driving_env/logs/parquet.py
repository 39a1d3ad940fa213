"""Tables of flat columns in Parquet files: the one place that knows pyarrow."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import LogError

METADATA_KEY = b"bevtown"
COMPRESSION_LEVEL = 12
"""Of zstd; higher levels take much longer for a few per cent."""
CURE = "delete that file and run the command that wrote it again"


def write_table(
    path: Path, columns: Mapping[str, NDArray[Any]], metadata: str, delta: tuple[str, ...] = ()
) -> None:
    """Write columns of equal length under a temporary name and rename the file.

    Args:
        path: The file.
        columns: Columns (M,) by name, int32, int64, float32 or float64.
        metadata: Text that is kept with them.
        delta: Integer columns that mostly count up by a constant or stay. The bytes of all others
            are split into streams, which is what compresses numbers whose high bytes vary little.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table({name: pa.array(column) for name, column in columns.items()})
    encodings = {
        name: "DELTA_BINARY_PACKED" if name in delta else "BYTE_STREAM_SPLIT" for name in columns
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with pq.ParquetWriter(
            str(temporary),
            table.schema,
            compression="zstd",
            compression_level=COMPRESSION_LEVEL,
            use_dictionary=False,
            column_encoding=encodings,
            write_statistics=False,
            write_page_checksum=True,
            # the types are those of Parquet; pyarrow's own schema would only take room
            store_schema=False,
        ) as writer:
            writer.write_table(table, row_group_size=max(1, table.num_rows))
            writer.add_key_value_metadata({METADATA_KEY: metadata.encode()})
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def read_metadata(path: Path) -> tuple[str, int]:
    """The text kept with a table, and its number of rows; no column is read.

    Raises:
        LogError: The file is not there, is truncated, or was not written by ``write_table``.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path) as file:
            footer = file.metadata
            kept, rows = (footer.metadata or {}).get(METADATA_KEY), footer.num_rows
    except (pa.ArrowException, OSError) as error:
        raise _unreadable(path, error) from error
    if kept is None:
        raise LogError(f"{path} is a Parquet file, but not of a BEVTown drive log; move it away")
    try:
        return kept.decode(), int(rows)
    except UnicodeDecodeError as error:
        raise LogError(f"{path} has damaged metadata ({error.reason}); {CURE}") from error


def read_columns(path: Path, columns: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Columns of a table, each checked for its type.

    Args:
        path: The file.
        columns: NumPy type of each column that is wanted.

    Raises:
        LogError: The file is truncated or damaged, or has no such column.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            missing = [name for name in columns if name not in file.schema_arrow.names]
            if missing:
                raise LogError(f"{path} has no column {missing[0]!r}; {CURE}")
            table = file.read(columns=list(columns))
    except (pa.ArrowException, OSError) as error:
        raise _unreadable(path, error) from error
    found = {name: np.asarray(table.column(name).to_numpy()) for name in columns}
    for name, kind in columns.items():
        if found[name].dtype != np.dtype(kind):
            raise LogError(
                f"{path}: column {name!r} must be {np.dtype(kind)}, got {found[name].dtype}; {CURE}"
            )
    return found


def _unreadable(path: Path, error: Exception) -> LogError:
    if isinstance(error, FileNotFoundError):
        return LogError(f"{path} is missing; {CURE.replace('delete that file and ', '')}")
    reason = str(error).partition("\n")[0]
    return LogError(f"{path} is truncated or not a Parquet file ({reason}); {CURE}")
