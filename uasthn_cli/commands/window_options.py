"""Options that say what is cut out of pairs, whether to learn from them or to judge by them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from uasthn_cli.commands.parameter_types import ABOVE_ZERO


def window_options(option: Callable[..., Any]) -> tuple[Any, ...]:
    """Return W_S, W_T, GSD, what is left out and what is drawn, as options of a help section."""
    return (
        option(
            "--ws",
            "window_m",
            type=ABOVE_ZERO,
            metavar="M",
            help="W_S: width of the satellite window.  [default: 1536; a flight: just enough for"
            " --dc]",
        ),
        option(
            "--wt",
            "thermal_m",
            type=ABOVE_ZERO,
            default=512.0,
            show_default=True,
            metavar="M",
            help="W_T: width of a rendered thermal image, and the most that is used of a frame.",
        ),
        option(
            "--gsd",
            "gsd_m",
            type=ABOVE_ZERO,
            metavar="M",
            help="Ground metres per pixel of rendered pairs and flights.  [default: the map's own,"
            " for flights half of it; needed for images without a georeference]",
        ),
        option(
            "--exclude-validation",
            is_flag=True,
            help="Leave out images of Boson-nighttime that see its validation region.",
        ),
        option(
            "--tgm",
            type=click.Path(exists=True, dir_okay=False, path_type=Path),
            metavar="GENERATOR.safetensors",
            help="Weights of `uasthn tgm train`: its network draws the thermal views of overhead"
            " images instead of the renderer.",
        ),
    )
