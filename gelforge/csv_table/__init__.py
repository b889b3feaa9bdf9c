"""CSV files as people write them; see `table`."""

from gelforge.csv_table.blocks import blocks
from gelforge.csv_table.cells import TableError
from gelforge.csv_table.form import CsvForm, RowFilter
from gelforge.csv_table.table import lines_of, read_columns, read_comments, read_csv

__all__ = [
    "CsvForm",
    "RowFilter",
    "TableError",
    "blocks",
    "lines_of",
    "read_columns",
    "read_comments",
    "read_csv",
]
