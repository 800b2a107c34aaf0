"""Archives of Parquet files: one file, a folder, or folders partitioned by date, tag or area.

``ParquetArchive`` is the connector, ``ParquetAddress`` how it travels. Only the columns, files and
row groups that a valve and a window need are read.
"""

from stemwatch.connectors.parquet.connector import (
    ParquetAddress,
    ParquetArchive,
    is_parquet,
    split_archives,
)

__all__ = ["ParquetAddress", "ParquetArchive", "is_parquet", "split_archives"]
