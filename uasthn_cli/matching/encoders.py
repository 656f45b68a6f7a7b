"""The two encoders of the learned cross-correlation, whatever runs them."""

import hashlib
from functools import lru_cache
from pathlib import Path
from typing import Protocol

import numpy as np

from uasthn_cli.matching.encoder_input import satellite_input, thermal_input
from uasthn_cli.matching.weights import XcorrWeights, read_xcorr, weights_misfit
from uasthn_cli.types import BoolArray, ImageArray, MapStatistics

_KEPT = 4
"""Networks that a process keeps ready."""


class Encoders(Protocol):
    """Turn pieces of map and frames into features that look alike.

    Sides of images are multiples of 16 pixels; features have half of them.
    """

    @property
    def channels(self) -> int:
        """Feature channels."""

    @property
    def temperature(self) -> float:
        """Factor that makes log-likelihoods of correlations."""

    @property
    def identity(self) -> str:
        """Equal identities mean equal features of equal images."""

    def satellite(self, rgb: ImageArray, valid: BoolArray, statistics: MapStatistics) -> ImageArray:
        """Return features ``(C, h / 2, w / 2)`` of colours ``(3, h, w)`` in 0..1."""

    def thermal(self, image: ImageArray, valid: BoolArray) -> ImageArray:
        """Return features ``(C, h / 2, w / 2)`` of a frame ``(h, w)``."""


class OnnxEncoders:
    """Encoders on the CPU, by ONNX Runtime in one thread of whoever calls."""

    def __init__(self, weights: XcorrWeights) -> None:
        """Build both networks.

        Raises:
            KeyError: a tensor is missing.
            ValueError: the tensors are of another architecture.
        """
        # both take a tenth of a second to load, which only runs with a network need spend
        import onnxruntime  # noqa: PLC0415

        from uasthn_cli.matching.onnx_graph import encoder_graph  # noqa: PLC0415

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.enable_mem_pattern = False  # frames differ in size
        digest = hashlib.sha256(f"onnxruntime {onnxruntime.__version__}".encode())
        sessions = []
        for prefix in ("satellite_encoder", "thermal_encoder"):
            graph = encoder_graph(weights.tensors, prefix)
            digest.update(graph)
            try:
                sessions.append(
                    onnxruntime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])
                )
            except onnxruntime.capi.onnxruntime_pybind11_state.Fail as error:
                raise ValueError(str(error)) from error
        self._satellite, self._thermal = sessions
        self.channels = weights.architecture.feature_channels
        self.temperature = float(np.exp(weights.tensors["log_temperature"]))
        self.identity = digest.hexdigest()

    def satellite(self, rgb: ImageArray, valid: BoolArray, statistics: MapStatistics) -> ImageArray:
        """Return features of a piece of map; see :class:`Encoders`."""
        return _run(self._satellite, satellite_input(rgb, valid, statistics))

    def thermal(self, image: ImageArray, valid: BoolArray) -> ImageArray:
        """Return features of a frame; see :class:`Encoders`."""
        return _run(self._thermal, thermal_input(image, valid))


def open_encoders(path: Path, device: str) -> Encoders:
    """Return the encoders of a weights file on ``cpu`` or ``cuda``.

    Those that look at one file from several scales share them: they hold no state.

    Raises:
        WeightsError: the file cannot be used.
    """
    if device != "cpu":
        # torch is heavy, and only a GPU needs it here
        from uasthn_cli.matching.torch_encoders import TorchEncoders  # noqa: PLC0415
        from uasthn_cli.matching.torch_weights import load_xcorr  # noqa: PLC0415

        return TorchEncoders(load_xcorr(path).model, device)
    try:
        content = path.read_bytes()
    except OSError:
        content = b""
    return _onnx_encoders(path, hashlib.sha256(content).hexdigest())


@lru_cache(maxsize=_KEPT)
def _onnx_encoders(path: Path, _: str) -> OnnxEncoders:
    """Return encoders by file and content."""
    try:
        return OnnxEncoders(read_xcorr(path))
    except (KeyError, IndexError, ValueError) as error:
        raise weights_misfit(path) from error


def _run(session: object, image: ImageArray) -> ImageArray:
    from uasthn_cli.matching.onnx_graph import INPUT, OUTPUT  # noqa: PLC0415

    features: ImageArray = session.run([OUTPUT], {INPUT: image[None]})[0][0]  # type: ignore[attr-defined]
    return features
