"""Options of ``uasthn train`` for dhn, ihn and sthn, gathered into one ``asked`` argument."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from uasthn_cli.commands.options import gathered
from uasthn_cli.commands.parameter_types import ABOVE_ZERO, FiniteRange
from uasthn_cli.commands.sections import section_option
from uasthn_cli.commands.window_options import window_options
from uasthn_cli.config import CROP_OFFSET_FRACTION, PAPER_THERMAL_PX

if TYPE_CHECKING:
    from uasthn_cli.training.displacement.config import DisplacementConfig

PRESETS: Final = ("paper-dhn", "paper-ihn", "paper-sthn", "laptop")
XCORR_ONLY: Final = (
    *("images", "sand_share", "landscape_share", "windows", "canvases", "without"),
    *("widths", "channels"),
)
"""Options, by the names of their values, that mean nothing to displacement networks."""

_CAMERA: Final = (
    *("hfov_deg", "focal_mm", "pixel_pitch_um", "camera_name", "distortion", "mount_yaw_deg"),
    *("mount_roll_deg", "mount_pitch_deg"),
)

pairs_option = section_option("Pairs (dhn, ihn, sthn)")
displacement_option = section_option("Training of dhn, ihn, sthn")


@dataclass(frozen=True, slots=True)
class AskedDisplacement:
    """The options as they were given; None where the preset or the paper decides."""

    dataset: str | None
    validation: str | None
    window_m: float | None
    thermal_m: float
    max_offset_m: float | None
    gsd_m: float | None
    yaw_error_deg: float
    scale_error: float
    exclude_validation: bool
    tgm: Path | None
    tgm_share: float | None
    preset: str
    batch: int | None
    views: int | None
    crop_offset_px: float
    plain_steps: int | None
    direct_modeling: bool
    first_stage: str

    def config(
        self,
        network: str,
        *,
        steps: int | None,
        learning_rate: float | None,
        seed: int,
        device: str,
        bfloat16: bool,
        workers: int,
        checkpoint_every: int,
    ) -> "DisplacementConfig":
        """Return how to train, what is not given from the preset.

        Raises:
            click.UsageError: options that make no sense together.
        """
        from uasthn_cli.training.displacement.config import LEARNING_RATE, DisplacementConfig
        from uasthn_cli.training.displacement.config import PRESETS as SIZES

        size = SIZES[self.preset]
        if size.network not in (None, network):
            raise click.UsageError(f"--preset {self.preset} is for --network {size.network}")
        steps = steps or size.steps
        views = self.views or (1 if self.direct_modeling else size.views)
        plain_steps = self.plain_steps
        if plain_steps is None:
            plain_steps = round(size.plain_share * steps) if views > 1 else 0
        elif views == 1:
            raise click.UsageError("--plain-steps says when crops begin, and there are none")
        if plain_steps >= steps and views > 1:
            raise click.UsageError(
                f"--plain-steps {plain_steps} leaves no step of {steps} to crops"
            )
        try:
            return DisplacementConfig(
                network=network,  # type: ignore[arg-type]  # click has checked the choice
                steps=steps,
                batch=self.batch or size.batch,
                plain_steps=plain_steps,
                views=views,
                crop_offset_fraction=self.crop_offset_px / PAPER_THERMAL_PX,
                direct_modeling=self.direct_modeling,
                first_stage=self.first_stage,  # type: ignore[arg-type]
                learning_rate=learning_rate or LEARNING_RATE,
                fine_satellite_px=size.fine_satellite_px,
                seed=seed,
                device=device,
                bfloat16=bfloat16,
                workers=workers,
                checkpoint_every=checkpoint_every,
            )
        except ValueError as error:
            raise click.UsageError(str(error)) from error


DISPLACEMENT_ONLY: Final = (*(field.name for field in fields(AskedDisplacement)), *_CAMERA)
"""Options, by the names of their values, that mean nothing to ``xcorr``."""

displacement_options: Final = gathered(
    "asked",
    AskedDisplacement,
    click.argument("dataset", metavar="[DATASET]", required=False),
    pairs_option(
        "--validate",
        "validation",
        metavar="DATASET",
        help="Pairs to judge by that are never trained on.  [default: of Boson-nighttime its part"
        " val, of overhead images other windows; else none]",
    ),
    *window_options(pairs_option),
    pairs_option(
        "--tgm-share",
        type=FiniteRange(0, 1, min_open=True),
        metavar="SHARE",
        help="Share of what is learnt from whose thermal views --tgm draws.  [default: 1; where the"
        " pairs have thermal images of their own, 0.5]",
    ),
    pairs_option(
        "--dc",
        "max_offset_m",
        type=ABOVE_ZERO,
        metavar="M",
        help="D_C: the farthest that the window's middle lies from the thermal image's."
        "  [default: 512; a flight: where the log has it]",
    ),
    pairs_option(
        "--yaw-error",
        "yaw_error_deg",
        type=FiniteRange(0, 45),
        default=0.0,
        show_default=True,
        metavar="DEG",
        help="Standard deviation of a rendered thermal image's turn against north.",
    ),
    pairs_option(
        "--scale-error",
        type=FiniteRange(0, 0.5),
        default=0.0,
        show_default=True,
        metavar="SHARE",
        help="Standard deviation of a rendered thermal image's scale.",
    ),
    displacement_option(
        "--preset",
        type=click.Choice(PRESETS),
        default="laptop",
        show_default=True,
        help="paper-…: 100,000 steps, then 200,000 with crops, 16 pairs a batch, for a GPU; laptop:"
        " 200 small steps. Other options go before it.",
    ),
    displacement_option(
        "--batch",
        type=click.IntRange(min=1),
        metavar="N",
        help="Pairs in a batch.  [default: the preset's]",
    ),
    displacement_option(
        "--croptta",
        "views",
        type=click.IntRange(min=1),
        metavar="N",
        help="N_C of the CropTTA loss: views of each thermal image, itself among them; 1: no crops."
        "  [default: the preset's]",
    ),
    displacement_option(
        "--crop-offset",
        "crop_offset_px",
        type=FiniteRange(0, PAPER_THERMAL_PX / 2, min_open=True),
        default=CROP_OFFSET_FRACTION * PAPER_THERMAL_PX,
        show_default=True,
        metavar="PX",
        help="o_c: how much smaller crops are, of 512 px.",
    ),
    displacement_option(
        "--plain-steps",
        type=click.IntRange(min=0),
        metavar="N",
        help="Steps before crops join.  [default: the preset's share of --steps]",
    ),
    displacement_option(
        "--dm",
        "direct_modeling",
        is_flag=True,
        help="Direct Modeling: a second head learns each corner's variance.",
    ),
    displacement_option(
        "--first-stage",
        type=click.Choice(["joint", "frozen"]),
        default="joint",
        show_default=True,
        help="Whether the first stage of sthn learns too, or stays as --init has it.",
    ),
)
