"""Kinds of option values that click does not know: each refuses nonsense in one line."""

import math
import re
from typing import Any, Final

import click
from click.shell_completion import CompletionItem

from uasthn_cli.matching.registry import estimator_names, spec_of
from uasthn_cli.synth.kinds import StressCategory


class FiniteNumber(click.types.FloatParamType):
    """A number that is neither infinite nor undefined."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the value as a float."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number", param, ctx)
        return number


class FiniteRange(click.FloatRange, FiniteNumber):
    """A finite number within bounds."""


ABOVE_ZERO: Final = FiniteRange(min=0, min_open=True)
ANY_NUMBER: Final = FiniteNumber()


class DistortionType(click.ParamType[tuple[float, ...]]):
    """Distortion coefficients, comma-separated, in OpenCV's order k1,k2,p1,p2[,k3,…]."""

    name = "K1,K2,P1,P2[,K3…]"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """Return the coefficients."""
        if isinstance(value, tuple):
            return value
        try:
            coefficients = tuple(float(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} is not a list of numbers separated by commas", param, ctx)
        if not all(map(math.isfinite, coefficients)):
            self.fail(f"{value!r} holds a number that is not finite", param, ctx)
        return coefficients


class StdThresholdType(click.ParamType[tuple[float, str]]):
    """A standard deviation with its unit: ``10m`` on the ground, ``4px`` at the width W_R."""

    name = "10m|4px"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, str]:
        """Return the number and ``m`` or ``px``."""
        if isinstance(value, tuple):
            return value
        match = re.fullmatch(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*(m|px)\s*", str(value))
        if match is None or float(match[1]) == 0:
            self.fail(
                f"{value!r} is not a positive number with its unit, say 10m or 4px", param, ctx
            )
        return float(match[1]), match[2]


class EstimatorType(click.ParamType[str]):
    """One of the package's own estimators, ``vismatch:NAME``, or another package's."""

    name = "NAME"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name; whether vismatch has the matcher is known only once it is loaded.

        Raises:
            PluginError: another package offers it, and cannot be used.
        """
        text = str(value)
        try:
            spec_of(text)
        except ValueError as error:
            hint = "vismatch:superpoint-lightglue"
            self.fail(f"{error}, with the name of a matcher, say {hint}", param, ctx)
        return text

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str | None:
        """Return all names for the help, those of other packages among them."""
        return "|".join(estimator_names())

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Offer the names that begin like this."""
        return [CompletionItem(name) for name in estimator_names() if name.startswith(incomplete)]


class CrsType(click.ParamType[str]):
    """``map`` for the map's own CRS, or ``EPSG:n``."""

    name = "map|EPSG:n"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return ``map`` or the EPSG code in capitals."""
        text = str(value)
        if text.lower() == "map":
            return "map"
        if re.fullmatch(r"(?i)epsg:\d+", text) is None:
            self.fail(f"{text!r} is neither 'map' nor an EPSG code such as EPSG:32640", param, ctx)
        return text.upper()


class StressType(click.ParamType[tuple[StressCategory, float]]):
    """A category of stress and its severity of 0 to 1, which is 1 if left out."""

    name = "CATEGORY[=SEVERITY]"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[StressCategory, float]:
        """Return the category and the severity."""
        if isinstance(value, tuple):
            return value
        name, given, severity = str(value).partition("=")
        if name not in list(StressCategory):
            self.fail(f"{name!r} is none of {', '.join(StressCategory)}", param, ctx)
        strength = FiniteRange(0, 1)(severity, param, ctx) if given else 1.0
        return StressCategory(name), strength
