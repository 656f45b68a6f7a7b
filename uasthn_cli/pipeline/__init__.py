"""Composition: from log, frames and map to one result per frame; writes nothing."""

from uasthn_cli.pipeline.driver import Outcome, drive
from uasthn_cli.pipeline.flight_stage import FusedFlight
from uasthn_cli.pipeline.job import GeotagJob
from uasthn_cli.pipeline.run import Run, open_run

__all__ = ["FusedFlight", "GeotagJob", "Outcome", "Run", "drive", "open_run"]
