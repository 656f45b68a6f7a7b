"""``uasthn tgm``: learn to draw thermal images from satellite images, and draw a map's."""

from pathlib import Path
from typing import Final

import click

from uasthn_cli.commands.console import progress, say
from uasthn_cli.commands.matching_options import DEVICES
from uasthn_cli.commands.options import output_option
from uasthn_cli.commands.tgm_train import VerboseCommand, train
from uasthn_cli.commands.training_options import machine_option

_EXAMPLES: Final = """\
\b
  uasthn tgm generate tgm.safetensors map.tif --out thermal.tif
"""


@click.group()
def tgm() -> None:
    """Draw thermal images of satellite maps (the paper's TGM).

    `train` learns from pairs of satellite and thermal images what a place seen by day may look like
    to a thermal camera; `generate` draws that of a whole map.
    """


tgm.add_command(train)


@tgm.command(cls=VerboseCommand, epilog=_EXAMPLES, short_help="Draw a map's.")
@click.argument("weights", metavar="WEIGHTS", type=click.Path(path_type=Path))
@click.argument("map_path", metavar="MAP", type=click.Path(path_type=Path))
@machine_option(
    "--device",
    type=click.Choice(DEVICES),
    default="auto",
    show_default=True,
    help="Where to draw; auto: a GPU if there is one.",
)
@output_option(
    "--out",
    type=click.Path(path_type=Path),
    required=True,
    metavar="THERMAL.tif",
    help="A GeoTIFF of one 8-bit band with the map's pixels and georeference; 0 is no data.",
)
@output_option("--overwrite", is_flag=True, help="Replace the file that is there.")
def generate(weights: Path, map_path: Path, device: str, out: Path, overwrite: bool) -> None:
    """Draw the thermal image of a whole map.

    WEIGHTS is a file of `uasthn tgm train`, MAP any georeferenced raster. The map is read at the
    resolution that the generator was trained at, in tiles that overlap by a quarter and are
    blended; memory does not depend on its size.
    """
    from uasthn_cli.training.tgm.thermal_generator import ThermalGenerator
    from uasthn_cli.training.tgm.thermal_map import ThermalMap

    thermal = ThermalMap(ThermalGenerator.open(weights, device), map_path)
    with progress("drawing", thermal.tiles) as advance:
        thermal.write(out, overwrite=overwrite, on_tile=advance)
    say(f"the thermal image of {map_path} is in {out}")
