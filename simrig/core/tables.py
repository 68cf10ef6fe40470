"""Tables for the terminal: one look for commands, studies and benchmarks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from string import Formatter
from typing import Any

MIB = 2.0**-20  # factor from bytes
# what a column shows of a row: a format such as "{seconds:.2f} s", or a function of the row
Column = str | Callable[[Any], Any]


def text_table(
    title: str,
    columns: Sequence[str],
    rows: Iterable[Sequence[Any]],
    *,
    left: Sequence[int] = (0,),
    below: Iterable[Sequence[Any]] = (),
    caption: str = "",
) -> Any:
    """Return a rich table.

    Args:
        title: above it; none where it is empty.
        rows: of cells; a float is shown with four digits, anything else as it is.
        left: indices of the columns that are aligned to the left; numbers read best to the right.
        below: more rows, under a line (sums and means).
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text  # plain text: a bracket in a cell is no markup

    made = Table(
        box=box.SIMPLE_HEAD,
        title=title or None,
        title_justify="left",
        caption=caption or None,
        caption_justify="left",
        pad_edge=False,
    )
    leading = {index % len(columns) for index in left}
    for index, column in enumerate(columns):
        justify: Any = "left" if index in leading else "right"
        made.add_column(column, justify=justify, overflow="fold")
    for part in (rows, below):
        for row in part:
            cells = (f"{cell:.4g}" if isinstance(cell, float) else str(cell) for cell in row)
            made.add_row(*map(Text, cells))
        made.add_section()
    return made


def record_table(
    title: str, columns: Mapping[str, Column], rows: Iterable[Mapping[str, Any]], **settings: Any
) -> Any:
    """Return a rich table of rows that have names for their values.

    Args:
        columns: what stands under each heading.
        settings: of ``text_table``.
    """
    made = ([shown(column, row) for column in columns.values()] for row in rows)
    return text_table(title, list(columns), made, **settings)


def named_rows(rows: Mapping[str, Mapping[str, Any]], key: str) -> list[dict[str, Any]]:
    """Return rows that are kept by name, each with its name under a key."""
    return [{key: name, **row} for name, row in rows.items()]


def known(column: str) -> Column:
    """Return a column that shows a dash where one of its values is None."""

    def shown_if_known(row: Mapping[str, Any]) -> str:
        names = [name for _, name, _, _ in Formatter().parse(column) if name]
        return "–" if any(row.get(name) is None for name in names) else column.format_map(row)

    return shown_if_known


def scaled(key: str, factor: float, format: str) -> Column:
    """Return a column that shows a value times a factor, a dash where there is none."""
    return lambda row: format.format(factor * row[key]) if row[key] else "–"


def shown(column: Column, row: Mapping[str, Any]) -> Any:
    """Return what a column shows of a row."""
    return column.format_map(row) if isinstance(column, str) else column(row)
