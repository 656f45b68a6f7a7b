"""Names that a person chooses from, free of heavy imports."""

from enum import StrEnum


class LandscapeKind(StrEnum):
    """What a landscape is mostly made of."""

    MIXED = "mixed"
    FARMS = "farms"
    TOWN = "town"
    FOREST = "forest"
    DUNES = "dunes"


class Route(StrEnum):
    """The shape of the ground track: parallel lanes (a lawn mower), or straights and wide turns."""

    SURVEY = "survey"
    TRACK = "track"


class Gain(StrEnum):
    """How temperatures become grey levels.

    ``plateau`` is histogram equalisation with clipped bins, the usual video output; ``percentile``
    a straight line between two percentiles; ``radiometric`` 14 bits in 16, linear in kelvin.
    """

    PLATEAU = "plateau"
    PERCENTILE = "percentile"
    RADIOMETRIC = "radiometric"


class StressCategory(StrEnum):
    """What is made wrong with a healthy flight: the paper's six failure cases, and a wrong place.

    ``textureless``: the scene fades into the sensor's noise; ``exposure``: too bright or too dark,
    clipped, with noise and stripes; ``geometry``: the frame's corners are shifted;
    ``self-similar``: map and frames show one pattern repeated; ``beyond-map``: the map ends below
    the flight; ``outdated``: other land cover on the map; ``wrong-place``: another place's map.
    """

    TEXTURELESS = "textureless"
    EXPOSURE = "exposure"
    GEOMETRY = "geometry"
    SELF_SIMILAR = "self-similar"
    BEYOND_MAP = "beyond-map"
    OUTDATED = "outdated"
    WRONG_PLACE = "wrong-place"
