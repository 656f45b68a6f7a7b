"""The encoders as ONNX graphs, written straight from their tensors: no torch, no exported file.

Layers and names are those of :class:`uasthn_cli.matching.networks.Encoder`; batch norms are folded
into the convolutions before them.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from onnx import ModelProto, NodeProto, TensorProto, ValueInfoProto, helper, numpy_helper

from uasthn_cli.types import ImageArray

INPUT, OUTPUT = "image", "features"

_OPSET, _IR = 17, 8
_BATCH_NORM_EPSILON = 1e-5
"""torch's default, which the networks are trained with."""


def encoder_graph(tensors: Mapping[str, ImageArray], prefix: str) -> bytes:
    """Return an ONNX model: image ``(1, channels, H, W)`` to features ``(1, C, H / 2, W / 2)``.

    ``tensors`` are a network's by name, of which those that start with ``prefix`` are used.

    Raises:
        KeyError: a tensor is missing.
    """
    graph = _Graph(tensors, prefix)
    level1 = graph.block("stem.1", graph.block("stem.0", INPUT, stride=2))
    level2 = graph.residual("down2.1", graph.block("down2.0", level1, stride=2))
    level3 = graph.residual("down3.1", graph.block("down3.0", level2, stride=2))
    level4 = graph.residual("down4.1", graph.block("down4.0", level3, stride=2))
    level4 = graph.residual("down4.2", level4)
    level3 = graph.residual("up3", graph.raised("lateral3", level4, level3))
    level2 = graph.residual("up2", graph.raised("lateral2", level3, level2))
    level1 = graph.block("up1", graph.raised("lateral1", level2, level1))
    graph.convolution("head", level1, into=OUTPUT)
    return graph.serialised()


class _Graph:
    """Nodes and constants of one encoder as they are added."""

    def __init__(self, tensors: Mapping[str, ImageArray], prefix: str) -> None:
        self._tensors, self._prefix = tensors, prefix
        self._nodes: list[NodeProto] = []
        self._constants: list[TensorProto] = []
        self._constant("doubled", np.array([1, 1, 2, 2], np.float32))
        self._channels_in = int(self._tensor("stem.0.0.weight").shape[1])
        self._channels_out = int(self._tensor("head.weight").shape[0])

    def block(self, name: str, source: str, *, stride: int = 1) -> str:
        """Add a convolution with its batch norm and a ReLU."""
        return self._add("Relu", [self._normalised(name, "0", "1", source, stride)])

    def residual(self, name: str, source: str) -> str:
        """Add two convolutions around an identity."""
        first = self.block(f"{name}.first", source)
        second = self._normalised(f"{name}.second", "0", "1", first)
        return self._add("Relu", [self._add("Add", [source, second])])

    def raised(self, name: str, coarse: str, fine: str) -> str:
        """Add a coarse level, through a 1 × 1 convolution and at twice its size, to a fine one."""
        enlarged = self._add(
            "Resize",
            [self.convolution(name, coarse), "", "doubled"],
            mode="linear",
            coordinate_transformation_mode="half_pixel",
        )
        return self._add("Add", [fine, enlarged])

    def convolution(self, name: str, source: str, *, into: str | None = None) -> str:
        """Add a convolution with a bias of its own."""
        weight, bias = self._tensor(f"{name}.weight"), self._tensor(f"{name}.bias")
        return self._convolution(name, weight, bias, source, 1, into)

    def serialised(self) -> bytes:
        """Return the model's bytes: equal tensors give equal ones."""
        graph = helper.make_graph(
            self._nodes,
            self._prefix,
            [_described(INPUT, self._channels_in, "height", "width")],
            [_described(OUTPUT, self._channels_out, "rows", "columns")],
            self._constants,
        )
        opset = helper.make_opsetid("", _OPSET)
        model: ModelProto = helper.make_model(graph, opset_imports=[opset], ir_version=_IR)
        return bytes(model.SerializeToString(deterministic=True))

    def _normalised(
        self, name: str, convolution: str, norm: str, source: str, stride: int = 1
    ) -> str:
        weight, own = self._tensor(f"{name}.{convolution}.weight"), f"{name}.{norm}"
        variance = self._tensor(f"{own}.running_var") + np.float32(_BATCH_NORM_EPSILON)
        scale = self._tensor(f"{own}.weight") / np.sqrt(variance)
        bias = self._tensor(f"{own}.bias") - self._tensor(f"{own}.running_mean") * scale
        folded = weight * scale[:, None, None, None]
        return self._convolution(name, folded, bias, source, stride, None)

    def _convolution(
        self,
        name: str,
        weight: ImageArray,
        bias: ImageArray,
        source: str,
        stride: int,
        into: str | None,
    ) -> str:
        self._constant(f"{name}.weight", weight)
        self._constant(f"{name}.bias", bias)
        inputs = [source, f"{name}.weight", f"{name}.bias"]
        margin = weight.shape[-1] // 2
        return self._add("Conv", inputs, into, pads=[margin] * 4, strides=[stride] * 2)

    def _add(self, kind: str, inputs: list[str], into: str | None = None, **attributes: Any) -> str:
        result = into or f"value{len(self._nodes)}"
        self._nodes.append(helper.make_node(kind, inputs, [result], **attributes))
        return result

    def _constant(self, name: str, value: NDArray[np.float32]) -> None:
        self._constants.append(numpy_helper.from_array(np.ascontiguousarray(value), name))

    def _tensor(self, name: str) -> ImageArray:
        return self._tensors[f"{self._prefix}.{name}"]


def _described(name: str, channels: int, rows: str, columns: str) -> ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, channels, rows, columns])
