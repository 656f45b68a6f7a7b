"""Errors a user can act on, and the exit code of each class.

Every message is one line: what is wrong, where, and what to do. The command line prints it on
stderr and exits with :attr:`UasthnError.exit_code`; docs/results.md lists the codes.
"""

from typing import ClassVar


class UasthnError(Exception):
    """Base of all errors that end a run with one clear line."""

    exit_code: ClassVar[int] = 1


class GateMissedError(UasthnError):
    """A gate of ``uasthn report`` (say ``--min-accepted``) was missed."""

    exit_code = 4


class LogUnreadableError(UasthnError):
    """The telemetry log is missing, empty or not a MAVLink ``.tlog``."""

    exit_code = 10


class NoPositionError(UasthnError):
    """The telemetry log holds no usable position or attitude."""

    exit_code = 11


class FramesError(UasthnError):
    """The folder of frames is missing or holds no image."""

    exit_code = 12


class FrameTimesError(UasthnError):
    """No capture time can be found for the frames, or the time base is unusable."""

    exit_code = 13


class CameraError(UasthnError):
    """The camera is unknown or described incompletely."""

    exit_code = 14


class MapUnreadableError(UasthnError):
    """The map is missing, corrupt or not a raster that GDAL reads."""

    exit_code = 15


class MapWithoutCrsError(UasthnError):
    """The map carries no coordinate reference system or no georeference."""

    exit_code = 16


class MapElsewhereError(UasthnError):
    """No part of the flight lies on the map."""

    exit_code = 17


class OutputError(UasthnError):
    """The output exists already (without ``--overwrite``) or cannot be written."""

    exit_code = 18


class WeightsError(UasthnError):
    """The network weights are missing, corrupt or of another architecture."""

    exit_code = 19


class TruthError(UasthnError):
    """The ground-truth table is missing, lacks a column or matches no frame."""

    exit_code = 20


class TrainingDataError(UasthnError):
    """No usable training image was found, or a checkpoint does not fit the request."""

    exit_code = 21


class ResultsError(UasthnError):
    """A results folder given to ``uasthn report`` is missing or incomplete."""

    exit_code = 22


class SyntheticFlightError(UasthnError):
    """A flight to be rendered is impossible, too large, or lies outside its map's CRS."""

    exit_code = 23


class TrainingDivergedError(UasthnError):
    """The loss of a training run is no longer a finite number."""

    exit_code = 24


class CalibrationError(UasthnError):
    """A calibration file is missing or damaged, or frames do not suffice to make one."""

    exit_code = 25


class MissingExtraError(UasthnError):
    """What was asked for needs an optional dependency that is not installed."""

    exit_code = 26


class DatasetError(UasthnError):
    """A data set to train on or evaluate with is missing, incomplete, or of no known layout."""

    exit_code = 27


class PredictionsError(UasthnError):
    """A predictions file of ``uasthn evaluate`` is missing, damaged, or of another kind."""

    exit_code = 28


class PluginError(UasthnError):
    """An estimator of another package cannot be used, or takes a name of this one's."""

    exit_code = 29


class WorkerLostError(UasthnError):
    """A process that looked at frames was killed."""

    exit_code = 30


class RunInterruptedError(UasthnError):
    """Ctrl-C stopped a run that goes on when the same command is given again."""

    exit_code = 130
