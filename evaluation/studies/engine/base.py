"""What a study is: a frozen configuration, cells that run on their own, and what follows.

A study reproduces a published table or figure, or asks a question of our own. Everything that
takes long is in its cells. A cell is a dictionary of plain values; ``run_cell`` turns it into
rows, in this process or in a worker on another machine. It depends on the configuration and the
cell alone, so a cell that is run twice gives the same rows. What is said about the rows
(``summarise``, ``table``, ``plots``) is cheap and is computed from stored rows whenever asked for.

``evaluation/studies/engine/run.py`` runs studies; docs/studies.md says how.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

# what JSON stores and gives back unchanged: None, bool, int, float, str, and lists
# and dictionaries of them; tuples come back as lists
Plain = Any
Config = Mapping[str, Plain]
Cell = Mapping[str, Plain]
Row = Mapping[str, Plain]

PRESETS = ("quick", "full")


@dataclass(frozen=True)
class Study:
    """One study.

    Attributes:
        name: lower case, words joined by hyphens; what the command line takes.
        source: where the published numbers are from, such as "thesis section 5.5.4, Table 5.3".
        presets: the frozen configurations "quick" (the one that tests run, or little more) and
            "full" (as published).
        cells: returns the cells of a configuration, plain values in a fixed order.
        run_cell: returns the rows of one cell, plain values. A function of a module, since
            workers import it by name; it may be called again for the same cell.
        summarise: returns what the rows say, published beside ours, plain values. The rows come
            in the order of the cells, each with the values of its cell added.
        table: returns a summary as something that rich can print.
        plots: draws what a summary and its rows show into an existing folder, and returns the
            files.
        keeps: ``run_cell`` also takes ``kept``, a folder for what a cell measured, so that a cell
            that was interrupted goes on from there; None where there is no folder at hand.
    """

    name: str
    about: str
    source: str
    presets: Mapping[str, Config]
    cells: Callable[[Config], list[dict[str, Plain]]]
    run_cell: Callable[..., list[dict[str, Plain]]]
    summarise: Callable[[Config, Sequence[Row]], dict[str, Plain]]
    table: Callable[[Mapping[str, Plain]], Any]
    plots: Callable[[Mapping[str, Plain], Sequence[Row], Path], list[Path]]
    keeps: bool = False

    @classmethod
    def of(cls, name: str, module: Any) -> Study:
        """Return the study that a module is: its functions and ``PRESETS``.

        The first line of the module's docstring is ``about``, its paragraph ``Source:`` the source.
        """
        said = [" ".join(part.split()) for part in (inspect.getdoc(module) or "").split("\n\n")]
        source = next(part for part in said if part.startswith("Source: "))
        return cls(
            name,
            said[0],
            source.removeprefix("Source: ").removesuffix("."),
            module.PRESETS,
            module.cells,
            module.run_cell,
            module.summarise,
            module.table,
            module.plots,
            "kept" in inspect.signature(module.run_cell).parameters,
        )


def one_per(**keys: str) -> Callable[[Config], list[dict[str, Plain]]]:
    """Return the ``cells`` of a study with one for each combination; the last key varies fastest.

    Args:
        keys: the key of a cell, and where the configuration lists its values.
    """

    def cells(config: Config) -> list[dict[str, Plain]]:
        values = product(*(config[name] for name in keys.values()))
        return [dict(zip(keys, each, strict=True)) for each in values]

    return cells
