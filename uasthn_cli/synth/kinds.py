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
