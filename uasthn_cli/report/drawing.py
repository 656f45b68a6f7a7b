"""How every figure looks, and how it becomes a file; the only importer of matplotlib.

Colours are those of Okabe and Ito, *Color Universal Design* (2008), told apart with any kind of
colour vision; no curve is told by its colour alone.
"""

import io
import textwrap
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final

from uasthn_cli.errors import MissingExtraError

try:
    import matplotlib as mpl
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, PercentFormatter
except ModuleNotFoundError as error:
    raise MissingExtraError(
        f"figures are drawn by matplotlib, which is not installed ({error.name} is missing):"
        " pip install 'uasthn[figures]'"
    ) from error

__all__ = [
    "BLUE",
    "GREEN",
    "HEIGHT_IN",
    "ORANGE",
    "REFERENCE",
    "WIDTH_IN",
    "Axes",
    "Figure",
    "FuncFormatter",
    "PercentFormatter",
    "encode",
    "legend_below",
    "legend_beside",
    "new_figure",
    "styled",
    "title",
]

WIDTH_IN, HEIGHT_IN = 8.0, 5.6
BLUE, ORANGE, GREEN = "#0072B2", "#D55E00", "#009E73"
REFERENCE: Final[Mapping[str, Any]] = {"color": "#555555", "linewidth": 1.2}

_LEGEND_CHARACTERS: Final = 84
"""As many fit under the axes side by side."""
_DOTS_PER_INCH: Final = 100
_STYLE: Final[Any] = {
    "svg.hashsalt": "uasthn",  # else the identifiers in an SVG differ from run to run
    "font.size": 12.0,
    "axes.titlesize": 13.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "axes.axisbelow": True,
    "lines.linewidth": 2.0,
    "legend.frameon": False,
    "legend.fontsize": 10.0,
    "legend.columnspacing": 1.4,
    "figure.constrained_layout.w_pad": 0.12,
    "figure.constrained_layout.h_pad": 0.08,
}


@contextmanager
def styled() -> Iterator[None]:
    """Draw in the house's style, whatever the user's own settings are, and undo it."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        yield


def new_figure() -> tuple[Figure, Axes]:
    """Return an empty figure with one pair of axes."""
    figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN), layout="constrained")
    return figure, figure.subplots()


def title(figure: Figure, what: str, name: str) -> None:
    """Write what is shown and of which run; the end of a long name is what tells runs apart."""
    shown = name if len(name) <= 60 else "…" + name[-59:]
    figure.suptitle(f"{what}: {shown}", parse_math=False)


def legend_below(figure: Figure, axes: Axes, columns: int = 3) -> None:
    """Explain the curves under the axes; long names are wrapped, so that all of them is seen."""
    handles, labels = axes.get_legend_handles_labels()
    wrapped = [textwrap.fill(label, _LEGEND_CHARACTERS // columns) for label in labels]
    figure.legend(handles, wrapped, loc="outside lower center", ncols=columns)


def legend_beside(figure: Figure, axes: Axes) -> None:
    """Explain the curves to the right of the axes."""
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right center")


def encode(figure: Figure | None, file_format: str) -> bytes | None:
    """Return the file's bytes, without date and version: they would differ for the same run."""
    if figure is None:
        return None
    FigureCanvasAgg(figure)
    metadata = {"Software": None} if file_format == "png" else {"Date": None, "Creator": None}
    content = io.BytesIO()
    figure.savefig(content, format=file_format, dpi=_DOTS_PER_INCH, metadata=metadata)
    return content.getvalue()
