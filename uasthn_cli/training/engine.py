"""Which parts of the data engine are on."""

from dataclasses import dataclass, fields
from typing import Final


@dataclass(frozen=True, slots=True)
class EngineConfig:
    """Parts of the data engine, all on unless one is switched off to see what it is worth.

    ``tone_curves``: random curves of a colour projection; off: the projection itself.
    ``cluster_temperatures``: colour clusters with temperatures of their own. ``texture``: fine
    structure, signed and rectified. ``relief``: Riesz transforms. ``sensor``: blur, drift, noise,
    stripes, clipping and objects that are not on the map. ``date_change``: map and thermal view of
    different dates. ``map_appearance``: exposure, balance and sharpness of the map.
    ``geometry_error``: yaw, scale and corners that the prior has wrong. ``scale_range``: pieces of
    any length and landscapes of any GSD; off: pieces at their own resolution, one GSD.
    """

    tone_curves: bool = True
    cluster_temperatures: bool = True
    texture: bool = True
    relief: bool = True
    sensor: bool = True
    date_change: bool = True
    map_appearance: bool = True
    geometry_error: bool = True
    scale_range: bool = True

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of the parts that are off, as they are typed."""
        return tuple(part for part in PARTS if not getattr(self, part.replace("-", "_")))


PARTS: Final = tuple(field.name.replace("_", "-") for field in fields(EngineConfig))
"""Names of all parts, as they are typed."""


def engine_without(parts: tuple[str, ...]) -> EngineConfig:
    """Return an engine with ``parts``, named as in :data:`PARTS`, switched off."""
    return EngineConfig(**dict.fromkeys((part.replace("-", "_") for part in parts), False))
