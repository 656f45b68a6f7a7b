"""Tables on stdout: for a terminal, or uncut for a pipe."""

import sys
from collections.abc import Sequence
from typing import Final

_PIPED_WIDTH: Final = 10_000


def print_table(cells: Sequence[Sequence[str]]) -> None:
    """Print rows of cells, the first being the header, the first column to the left.

    As wide as the terminal, or uncut and uncoloured for a pipe or a file.
    """
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    header, *rows = cells
    table = Table(show_edge=False, pad_edge=False)
    table.add_column(header[0])
    for name in header[1:]:
        table.add_column(Text(name), justify="right", overflow="fold")
    for row in rows:
        table.add_row(*map(Text, row))
    is_terminal = sys.stdout.isatty()
    console = Console(width=None if is_terminal else _PIPED_WIDTH, no_color=not is_terminal)
    console.print(table)
