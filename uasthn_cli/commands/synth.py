"""``uasthn synth``: render a flight over a made-up place, with its truth."""

from pathlib import Path
from typing import Any, Final

import click

from uasthn_cli.commands.aircraft_options import aircraft_options
from uasthn_cli.commands.console import progress, say
from uasthn_cli.commands.parameter_types import FiniteRange, StressType
from uasthn_cli.commands.sections import SectionedCommand, section_option
from uasthn_cli.synth.aircraft_errors import AircraftErrors
from uasthn_cli.synth.flight_config import FlightConfig, SensorConfig, StressConfig
from uasthn_cli.synth.kinds import Gain, LandscapeKind, Route, StressCategory

_EXAMPLES: Final = """\
\b
A flight over dunes, then geo-tag it and see how well that went:
  uasthn synth flights/dunes --kind dunes --frames 40 --drift-m 120
  uasthn geotag flights/dunes/flight.tlog flights/dunes/frames \\
      --map flights/dunes/map.tif --hfov 45 --truth flights/dunes/truth.csv --out out/dunes
  uasthn report out/dunes --baseline prior
A map in degrees, 16-bit radiometric frames and camera messages in the log:
  uasthn synth flights/degrees --crs EPSG:4326 --gain radiometric --camera-messages
What a real aircraft has: a mount a little off, hills, a lens, a clock, lost frames:
  uasthn synth flights/real --mount-roll 1 --mount-pitch -2 --attitude-drift-deg 1 \\
      --relief-m 60 --lens-k1 -0.12 --clock-late-s 0.4 --lose-frames 0.1
A flight that should be rejected, for a third of the map is out of date:
  uasthn synth flights/outdated --stress outdated=0.33
"""

_DEFAULT: Final = FlightConfig()

place_option = section_option("Place")
flight_option = section_option("Flight")
camera_option = section_option("Camera")
log_option = section_option("Log: what the GPS and the compass get wrong")
stress_option = section_option("Stress: what makes it hard to place")
output_option = section_option("Output")


@click.command(
    cls=SectionedCommand, epilog=_EXAMPLES, short_help="Render a flight over a made-up place."
)
@click.argument("out", metavar="OUT", type=click.Path(path_type=Path))
@place_option(
    "--seed",
    type=click.IntRange(min=0),
    default=_DEFAULT.seed,
    show_default=True,
    help="Which place.",
)
@place_option(
    "--kind",
    type=click.Choice([kind.value for kind in LandscapeKind]),
    default=_DEFAULT.kind.value,
    show_default=True,
    help="What the place is mostly made of.",
)
@place_option(
    "--gsd-m",
    "map_gsd_m",
    type=FiniteRange(0.05, 50),
    default=_DEFAULT.map_gsd_m,
    show_default=True,
    metavar="M",
    help="Metres per pixel of the map.",
)
@place_option(
    "--lat",
    "lat_deg",
    type=FiniteRange(-80, 80),
    default=_DEFAULT.lat_deg,
    show_default=True,
    metavar="DEG",
    help="Where on earth the place is put.",
)
@place_option(
    "--lon",
    "lon_deg",
    type=FiniteRange(-180, 180),
    default=_DEFAULT.lon_deg,
    show_default=True,
    metavar="DEG",
    help="Where on earth the place is put.",
)
@place_option(
    "--crs", "map_crs", metavar="CRS", help="The map's CRS, say EPSG:4326 [default: UTM]."
)
@flight_option(
    "--frames", type=click.IntRange(min=1), default=_DEFAULT.frames, show_default=True, metavar="N"
)
@flight_option(
    "--route",
    type=click.Choice([route.value for route in Route]),
    default=_DEFAULT.route.value,
    show_default=True,
    help="Parallel lanes, or straights joined by wide turns.",
)
@flight_option(
    "--height-m",
    type=FiniteRange(10, 5000),
    default=_DEFAULT.height_m,
    show_default=True,
    metavar="M",
    help="Height above ground.",
)
@flight_option(
    "--overlap",
    type=FiniteRange(0, 0.95),
    default=_DEFAULT.overlap,
    show_default=True,
    metavar="SHARE",
    help="Share of a frame that the next frame and the next lane see again.",
)
@flight_option(
    "--wind-m-s",
    type=FiniteRange(0, 14),
    default=_DEFAULT.wind_m_s,
    show_default=True,
    metavar="M/S",
    help="Wind speed; the aircraft flies at 18 m/s and crabs into it.",
)
@camera_option(
    "--hfov",
    "hfov_deg",
    type=FiniteRange(5, 120),
    default=_DEFAULT.hfov_deg,
    show_default=True,
    metavar="DEG",
    help="Horizontal field of view.",
)
@camera_option(
    "--frame-size",
    "frame_size_px",
    type=(click.IntRange(32, 4096), click.IntRange(32, 4096)),
    default=(_DEFAULT.frame_width_px, _DEFAULT.frame_height_px),
    show_default=True,
    metavar="WIDTH HEIGHT",
    help="Pixels of a frame.",
)
@camera_option(
    "--gain",
    type=click.Choice([gain.value for gain in Gain]),
    default=_DEFAULT.sensor.gain.value,
    show_default=True,
    help="How temperatures become grey: 8-bit equalised, 8-bit linear, or 16-bit radiometric.",
)
@log_option(
    "--drift-m",
    type=FiniteRange(0, 5000),
    default=_DEFAULT.drift_m,
    show_default=True,
    metavar="M",
    help="The farthest that the logged position strays, over minutes.",
)
@log_option(
    "--yaw-bias-deg",
    type=FiniteRange(0, 20),
    default=_DEFAULT.yaw_bias_deg,
    show_default=True,
    metavar="DEG",
    help="The most that the logged heading is off, throughout.",
)
@log_option(
    "--height-bias",
    type=FiniteRange(0, 0.3),
    default=_DEFAULT.height_bias,
    show_default=True,
    metavar="SHARE",
    help="The most that the logged height is off, throughout.",
)
@log_option("--camera-messages", is_flag=True, help="Log a CAMERA_FEEDBACK at every exposure.")
@aircraft_options
@stress_option(
    "--stress",
    type=StressType(),
    help="Make one thing wrong, wholly or to a share of 0 to 1: "
    + ", ".join(StressCategory)
    + ". The truth stays true.",
)
@output_option("--jpeg-map", is_flag=True, help="Compress the map as JPEG, a fifth of the size.")
@output_option("--overwrite", is_flag=True, help="Replace the rendered flight that is in OUT.")
def synth(
    out: Path,
    seed: int,
    kind: str,
    route: str,
    frame_size_px: tuple[int, int],
    gain: str,
    stress: tuple[StressCategory, float] | None,
    overwrite: bool,
    errors: AircraftErrors,
    **settings: Any,
) -> None:
    """Render a flight by night over a made-up place, with its truth.

    OUT becomes a folder with map.tif (the place by day from space), frames/ (the thermal frames),
    flight.tlog (MAVLink 2, with a GPS that drifts) and truth.csv (where each frame really was);
    with --relief-m also dem.tif (heights above sea level).
    Fields are re-cropped, vehicles and a few buildings and tracks come and go between map and
    flight. The same options give the same bytes.
    """
    from uasthn_cli.synth.flight import render_flight
    from uasthn_cli.synth.stress import render_stressed_flight

    config = FlightConfig(
        seed=seed,
        kind=LandscapeKind(kind),
        route=Route(route),
        frame_width_px=frame_size_px[0],
        frame_height_px=frame_size_px[1],
        sensor=SensorConfig(gain=Gain(gain), pattern_seed=seed),
        errors=errors,
        **settings,  # the other options bear the names of its fields
    )
    with progress("Rendering", config.frames) as advance:
        if stress is None:
            flight = render_flight(out, config, overwrite=overwrite, on_frame=advance)
        else:
            wrong = StressConfig(*stress, seed=seed)
            flight = render_stressed_flight(
                out, config, wrong, overwrite=overwrite, on_frame=advance
            )
    click.echo(out)
    say(
        f"geo-tag it: uasthn geotag {flight.log} {flight.frames} --map {flight.map}"
        f" --hfov {config.hfov_deg:g} --truth {flight.truth} --out OUT"
    )
