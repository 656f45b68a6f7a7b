"""Options that several commands share: declared and validated once, handed on as one object.

Each decorator adds a section of options and replaces them by a single argument: ``camera`` (a
:class:`~uasthn_cli.ingest.cameras.CameraSpec`), ``prior`` (a
:class:`~uasthn_cli.config.PriorConfig`).
"""

import functools
import inspect
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from uasthn_cli.commands.parameter_types import (
    ABOVE_ZERO,
    ANY_NUMBER,
    DistortionType,
    FiniteRange,
)
from uasthn_cli.commands.sections import section_option
from uasthn_cli.config import DemDatum, PairBy, PriorConfig, TimeBase

if TYPE_CHECKING:
    from uasthn_cli.ingest.cameras import CameraSpec

Command = Callable[..., Any]
Decorator = Callable[[Command], Command]

_PRIOR: Final = PriorConfig()

output_option = section_option("Output")
camera_option = section_option("Camera (one of --hfov, --focal-mm, --camera)")
time_option = section_option("Time and height")


def out_option(help_text: str, required: bool = True, default: Path | None = None) -> Decorator:
    """Return the ``--out DIR`` option."""
    return output_option(
        "--out",
        type=click.Path(path_type=Path),
        required=required,
        default=default,
        metavar="DIR",
        help=help_text,
    )


overwrite_option: Final = output_option(
    "--overwrite", is_flag=True, help="Replace the results that are in the output folder."
)


def gathered(name: str, build: Callable[..., Any], *options: Decorator) -> Decorator:
    """Return a decorator that adds options and passes ``name=build(**their values)`` instead."""
    taken = list(inspect.signature(build).parameters)

    def decorate(command: Command) -> Command:
        @functools.wraps(command)
        def run_gathered(**values: Any) -> Any:
            values[name] = build(**{key: values.pop(key) for key in taken})
            return command(**values)

        decorated: Command = run_gathered
        for option in reversed(options):
            decorated = option(decorated)
        return decorated

    return decorate


def _camera_spec(
    hfov_deg: float | None,
    focal_mm: float | None,
    pixel_pitch_um: float | None,
    camera_name: str | None,
    distortion: tuple[float, ...],
    mount_yaw_deg: float,
    mount_roll_deg: float,
    mount_pitch_deg: float,
) -> "CameraSpec":
    """Return the camera that the options describe; contradictions are its own to refuse."""
    from uasthn_cli.ingest.cameras import CameraSpec

    return CameraSpec(
        hfov_deg=hfov_deg,
        focal_mm=focal_mm,
        pixel_pitch_um=pixel_pitch_um,
        name=camera_name,
        distortion=distortion,
        mount_yaw_deg=mount_yaw_deg,
        mount_roll_deg=mount_roll_deg,
        mount_pitch_deg=mount_pitch_deg,
    )


def _prior_config(
    time_base: str,
    pair_by: str,
    time_offset_s: float,
    max_gap_s: float,
    height_m: float | None,
    dem_path: Path | None,
    dem_datum: str,
) -> PriorConfig:
    """Return how log and frame times are joined, and what heights rest on."""
    if dem_path is not None and height_m is not None:
        raise click.UsageError("--dem takes heights from the log: leave out --height-m")
    return PriorConfig(
        time_base=TimeBase(time_base),
        time_offset_s=time_offset_s,
        max_gap_s=max_gap_s,
        height_above_ground_m=height_m,
        pair_by=PairBy(pair_by),
        dem_path=dem_path,
        dem_datum=DemDatum(dem_datum),
    )


camera_options: Final = gathered(
    "camera",
    _camera_spec,
    camera_option(
        "--hfov",
        "hfov_deg",
        type=FiniteRange(0, 180, min_open=True, max_open=True),
        metavar="DEG",
        help="Horizontal field of view, across the full width of the frame.",
    ),
    camera_option(
        "--focal-mm",
        type=ABOVE_ZERO,
        metavar="MM",
        help="Focal length; needs --pixel-pitch-um.",
    ),
    camera_option(
        "--pixel-pitch-um", type=ABOVE_ZERO, metavar="UM", help="Distance between pixel centres."
    ),
    camera_option(
        "--camera",
        "camera_name",
        metavar="NAME",
        help="A camera of the built-in table; `uasthn cameras` lists it.",
    ),
    camera_option(
        "--distortion",
        type=DistortionType(),
        default=(),
        help="Lens distortion, OpenCV's order.",
    ),
    camera_option(
        "--mount-yaw",
        "mount_yaw_deg",
        type=ANY_NUMBER,
        default=0.0,
        metavar="DEG",
        show_default=True,
        help="Turn of the camera about the aircraft's down axis, clockwise seen from above; 0: the"
        " top of the image is the nose.",
    ),
    camera_option(
        "--mount-roll",
        "mount_roll_deg",
        type=FiniteRange(-30, 30),
        default=0.0,
        metavar="DEG",
        show_default=True,
        help="Roll of the camera against the aircraft: positive looks left.",
    ),
    camera_option(
        "--mount-pitch",
        "mount_pitch_deg",
        type=FiniteRange(-30, 30),
        default=0.0,
        metavar="DEG",
        show_default=True,
        help="Pitch of the camera against the aircraft: positive looks ahead.",
    ),
)

prior_options: Final = gathered(
    "prior",
    _prior_config,
    time_option(
        "--time-base",
        type=click.Choice([base.value for base in TimeBase]),
        default=_PRIOR.time_base.value,
        show_default=True,
        help="Which clock dates the log: the ground station's (record), the vehicle's"
        " (SYSTEM_TIME), or whichever fits the frames (auto).",
    ),
    time_option(
        "--pair-by",
        type=click.Choice([kind.value for kind in PairBy]),
        default=_PRIOR.pair_by.value,
        show_default=True,
        help="What tells which of the log's camera messages each frame has: the camera's file"
        " names, the frames' own times, the numbers in both, or their order; none leaves the"
        " messages alone. auto refuses what is not clear.",
    ),
    time_option(
        "--time-offset",
        "time_offset_s",
        type=ANY_NUMBER,
        default=_PRIOR.time_offset_s,
        metavar="SECONDS",
        show_default=True,
        help="Added to every frame's time before it is looked up in the log. Example: a frame"
        " named 12:00:00 was taken when the log read 12:00:02.5, so --time-offset 2.5.",
    ),
    time_option(
        "--max-gap",
        "max_gap_s",
        type=ABOVE_ZERO,
        default=_PRIOR.max_gap_s,
        metavar="SECONDS",
        show_default=True,
        help="Longest hole in the log that is interpolated across.",
    ),
    time_option(
        "--height-m",
        type=ABOVE_ZERO,
        metavar="M",
        help="Height above ground of the whole flight, instead of the log's.",
    ),
    time_option(
        "--dem",
        "dem_path",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="Elevation model of the area, any raster of heights that GDAL reads: frames are"
        " rectified over its relief and their corners lie on it.  [default: flat ground, as far"
        " below each frame as the log says]",
    ),
    time_option(
        "--dem-datum",
        type=click.Choice([datum.value for datum in DemDatum]),
        default=_PRIOR.dem_datum.value,
        show_default=True,
        help="What ties the log's altitudes to the model: the ground at take-off and the heights"
        " above it, which needs no common datum; altitudes above sea level (amsl); or the log's"
        " heights, right on the flight's average. auto: take-off where the log starts there, else"
        " whichever of the others the frames fit.",
    ),
)


def given_options(context: click.Context, names: Iterable[str]) -> list[str]:
    """Return, as they are typed, which of these options or arguments were given."""
    return [
        option.opts[0] if isinstance(option, click.Option) else str(option.name).upper()
        for option in context.command.params
        if option.name in set(names) and if_given(context, str(option.name)) is not None
    ]


def if_given(context: click.Context, name: str) -> Any:
    """Return a value that was typed, None where it is a default."""
    source = context.get_parameter_source(name)
    typed = source is click.core.ParameterSource.COMMANDLINE
    return context.params[name] if typed else None
