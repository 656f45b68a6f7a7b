"""Methods of uncertainty estimation: what each needs, and what it makes of a frame's answers.

Answers come as in :mod:`uasthn_cli.uncertainty.merge`.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from uasthn_cli.config import Aggregation, Merge, UeMethod
from uasthn_cli.types import FloatArray
from uasthn_cli.uncertainty.merge import (
    crop_corners,
    crop_std,
    ensemble_corners,
    ensemble_std,
    merged_std,
)

OF_CROPS: Final = (UeMethod.CROPTTA, UeMethod.CROPTTA_DE)
"""Methods that look at crops of the frame."""

OF_MEMBERS: Final = (UeMethod.DE, UeMethod.CROPTTA_DE)
"""Methods that ask several networks."""

_RICHEST_FIRST: Final = (
    UeMethod.CROPTTA_DE,
    UeMethod.CROPTTA,
    UeMethod.DE,
    UeMethod.DM,
    UeMethod.NONE,
)


@dataclass(frozen=True, slots=True)
class Offer:
    """What there is to tell an answer's uncertainty by.

    ``views`` the base network has of a frame, ``members`` of the ensemble, the base network among
    them, whether that one has Direct Modeling's second head, and whether an ensemble is in the box.
    """

    estimator: str
    views: int
    members: int
    has_head: bool
    has_box_ensemble: bool = False


@dataclass(frozen=True, slots=True)
class UncertaintyChoice:
    """How answers become one, and how far they agree: the method and its two settings."""

    method: UeMethod = UeMethod.CROPTTA
    merge: Merge = Merge.MAX
    aggregation: Aggregation = Aggregation.ORIGINAL


def refusal(method: UeMethod, offer: Offer) -> str | None:
    """Return why a method cannot be had, or None."""
    if method in OF_CROPS and offer.views < 2:
        return f"{method} needs crops, say --views 5: one view cannot disagree with itself"
    if method in OF_MEMBERS and offer.members < 2:
        box = ", or --ensemble" if offer.has_box_ensemble else ""
        return f"{method} needs an ensemble: give --weights several times{box}"
    if method is UeMethod.DM and not offer.has_head:
        return f"{method} needs a network with a second head; {offer.estimator} has none"
    return None


def richest_method(offer: Offer) -> UeMethod:
    """Return the method that uses most of what there is; crops and members before a head."""
    return next(method for method in _RICHEST_FIRST if refusal(method, offer) is None)


def paper_aggregation(method: UeMethod) -> Aggregation:
    """Return the paper's choice (sec. IV-A): DE prefers the mean, CropTTA the original image's."""
    return Aggregation.MEAN if method in OF_MEMBERS else Aggregation.ORIGINAL


def frame_corners(answers: FloatArray, choice: UncertaintyChoice) -> FloatArray:
    """Return the answer ``(..., 4, 2)`` for the full frame."""
    if choice.method in OF_MEMBERS:
        return ensemble_corners(answers, choice.aggregation)
    if choice.method is UeMethod.CROPTTA:
        return crop_corners(answers, choice.aggregation)
    return answers[..., 0, 0, :, :]


def frame_std(
    answers: FloatArray, modelled_std: FloatArray | None, choice: UncertaintyChoice
) -> FloatArray:
    """Return the deviation of its corners ``(..., 4, 2)``; 0 without any method.

    ``modelled_std`` ``(..., 4, 2)`` is what the base network itself says.

    Raises:
        ValueError: Direct Modeling of a network that says nothing.
    """
    if choice.method is UeMethod.CROPTTA:
        return crop_std(answers)
    if choice.method is UeMethod.DE:
        return ensemble_std(answers)
    if choice.method is UeMethod.CROPTTA_DE:
        return merged_std(crop_std(answers), ensemble_std(answers), choice.merge)
    if choice.method is UeMethod.DM:
        if modelled_std is None:
            raise ValueError(f"{choice.method} of a network that says nothing of its error")
        return modelled_std
    return np.zeros((*answers.shape[:-4], 4, 2))
