"""Tables on the console."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd


def print_table(table: pd.DataFrame, formats: Mapping[str, str], title: str, caption: str = "") -> None:
    """Print a table with numbers right-aligned; formats: of columns, such as "+.4f"; others are printed as they are."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    shown = Table(
        box=box.SIMPLE, padding=(0, 1, 0, 0), title=title, caption=caption
    )  # ten columns in 80 characters
    for name, kind in table.dtypes.items():
        right = pd.api.types.is_numeric_dtype(kind)
        shown.add_column(str(name), justify="right" if right else "left", no_wrap=True)
    for row in table.itertuples(index=False):
        shown.add_row(*(format(value, formats.get(name, "")) for name, value in zip(table, row)))
    Console().print(shown)
