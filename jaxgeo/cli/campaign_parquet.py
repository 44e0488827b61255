"""A campaign's table as Parquet: typed columns, missing values as nulls, versions in the file's metadata."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jaxgeo.cli.campaign_columns import CampaignColumn
from jaxgeo.errors import InputError
from jaxgeo.io.atomic import atomic_path


def need_pyarrow() -> None:
    """Refuse at once where it is missing: before a long computation, not after it.

    Raises:
        InputError: says how to install it.
    """
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError as error:
        raise InputError(f"jaxgeo campaign needs pyarrow ({error}): pip install 'jaxgeo[campaign]'") from None


def write_parquet(
    path: Path, columns: Sequence[CampaignColumn], rows: Sequence[Mapping[str, Any]], metadata: Mapping[str, str]
) -> None:
    """Write the rows, whole or not at all.

    Raises:
        InputError: the folder cannot be written to, or pyarrow is missing.
    """
    need_pyarrow()
    import pyarrow as pa
    import pyarrow.parquet as pq

    types = {"text": pa.string(), "integer": pa.int64(), "number": pa.float64(), "truth": pa.bool_()}
    schema = pa.schema([(column.name, types[column.kind]) for column in columns], metadata=dict(metadata))
    with atomic_path(path) as temporary:
        pq.write_table(pa.Table.from_pylist([dict(row) for row in rows], schema=schema), temporary)
