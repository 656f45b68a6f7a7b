"""What an uncooled microbolometer camera makes of a temperature field.

Order of effects: optics blur, vignetting and the warm lens (narcissus), column and row fixed
pattern, temporal noise (NETD), dead pixels, then gain control to 8 bits or 14 bits radiometric.
Typical figures are those of the FLIR Boson and Tau 2 data sheets (NETD 50 mK at f/1.0, 0.04 K per
count in high-resolution TLinear) and of 8-bit nadir night frames of HIT-UAV (grain of 1 to 3 of 255
levels); what is smaller than the grain by day is not on a night of little contrast.
"""

import numpy as np
from numpy.typing import NDArray

from uasthn_cli.synth.flight_config import SensorConfig
from uasthn_cli.synth.kinds import Gain
from uasthn_cli.synth.noise import fractal_noise, smooth
from uasthn_cli.types import ImageArray

__all__ = ["KELVIN_PER_COUNT", "SensorConfig", "render_sensor"]

KELVIN_PER_COUNT = 0.04
"""Radiometric scale of the 16-bit output (FLIR TLinear, high resolution)."""

_HISTOGRAM_BINS = 1024
_EQUALISED = 0.35


def render_sensor(
    temperature: ImageArray, rng: np.random.Generator, config: SensorConfig
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Return the frame ``(h, w)`` that the camera takes of a temperature field in kelvin.

    Temporal noise comes from ``rng``, the fixed pattern from ``config.pattern_seed``. The result
    is uint8, or uint16 with 14 significant bits for :attr:`Gain.RADIOMETRIC`.
    """
    signal = smooth(np.asarray(temperature, dtype=np.float32), config.blur_px)
    signal = signal + _fixed_pattern(signal.shape, config)
    noise = rng.standard_normal(signal.shape, dtype=np.float32)
    signal += np.float32(config.netd_k) * noise
    _kill_pixels(signal, config)
    if config.gain is Gain.RADIOMETRIC:
        counts = np.clip(np.round(signal / KELVIN_PER_COUNT), 0, 2**14 - 1)
        return counts.astype(np.uint16)
    if config.gain is Gain.PERCENTILE:
        return _stretched(signal, config)
    return _plateau_equalised(signal, config)


def _fixed_pattern(shape: tuple[int, ...], config: SensorConfig) -> ImageArray:
    """Return what the camera adds to every frame ``(h, w)`` in kelvin."""
    rng = np.random.default_rng(config.pattern_seed)
    height, width = shape[0], shape[1]
    columns = config.column_pattern_k * rng.standard_normal((1, width))
    rows = config.row_pattern_k * rng.standard_normal((height, 1))
    pixels = config.pixel_pattern_k * rng.standard_normal((height, width), dtype=np.float32)
    y, x = np.mgrid[-1.0 : 1.0 : height * 1j, -1.0 : 1.0 : width * 1j]
    x0, y0 = rng.normal(0.0, 0.15, 2)
    bowl = -0.5 * config.vignetting_k * ((x - x0) ** 2 + (y - y0) ** 2)
    drift = fractal_noise(rng, (height, width), 1.0, 1.2 * width)
    shading = bowl + 0.2 * config.vignetting_k * drift
    return np.asarray(columns + rows + pixels + shading, dtype=np.float32)


def _kill_pixels(signal: ImageArray, config: SensorConfig) -> None:
    """Give dead pixels a value of their own, as far off as the scene reaches."""
    count = round(config.dead_pixel_share * signal.size)
    if count == 0:
        return
    rng = np.random.default_rng((config.pattern_seed, 1))
    places = rng.choice(signal.size, count, replace=False)
    ends = np.array([signal.min(), signal.max()], dtype=np.float32)
    signal.flat[places] = ends[rng.integers(0, 2, count)]


def _span_k(signal: ImageArray, config: SensorConfig, tail_percent: float) -> tuple[float, float]:
    """Return the temperatures that become black and white."""
    low, high = (
        float(v) for v in np.percentile(signal[::2, ::2], (tail_percent, 100.0 - tail_percent))
    )
    missing = max(0.0, config.least_span_k - (high - low))
    return low - 0.5 * missing, high + 0.5 * missing


def _stretched(signal: ImageArray, config: SensorConfig) -> NDArray[np.uint8]:
    """Map a percentile range linearly to 0..255."""
    low, high = _span_k(signal, config, 0.5)
    levels = (signal - low) * (255.0 / (high - low)) + 0.5
    return np.asarray(np.clip(levels, 0.0, 255.0).astype(np.uint8))


def _plateau_equalised(signal: ImageArray, config: SensorConfig) -> NDArray[np.uint8]:
    """Equalise the histogram, no bin counting more than the plateau, mixed with a straight line."""
    low, high = _span_k(signal, config, 0.1)
    scale = (_HISTOGRAM_BINS - 1) / (high - low)
    bins = np.clip((signal - low) * scale, 0, _HISTOGRAM_BINS - 1).astype(np.int32)
    histogram = np.bincount(bins.ravel(), minlength=_HISTOGRAM_BINS)
    clipped = np.minimum(histogram, config.plateau * signal.size)
    equalised = np.cumsum(clipped) / max(1.0, float(clipped.sum()))
    linear = np.linspace(0.0, 1.0, _HISTOGRAM_BINS)
    table = np.round(255.0 * (_EQUALISED * equalised + (1.0 - _EQUALISED) * linear)).astype(
        np.uint8
    )
    levels: NDArray[np.uint8] = table[bins]
    return levels
