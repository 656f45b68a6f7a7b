"""IHN written down as it is published, with torch's own operations: what its cost is measured in.

The weights are those of the package's network; only how the same numbers are come by differs.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from uasthn_cli.matching.displacement.correlation import RADIUS
from uasthn_cli.matching.displacement.encoder import FeatureEncoder, ResidualUnit
from uasthn_cli.matching.displacement.ihn import IterativeHomographyNetwork, looked_at
from uasthn_cli.matching.displacement.pooling import MaxHalved
from uasthn_cli.matching.displacement.update import UpdateBlock

_IMAGENET = ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))


def locate_plainly(
    network: IterativeHomographyNetwork, satellite: Tensor, thermal: Tensor, iterations: int
) -> Tensor:
    """Return displacements ``(1, 4, 2)`` of images ``(1, 3, 256, 256)``."""
    levels = _levels(
        _encode(network.fnet1, satellite),
        _encode(network.fnet1, thermal),
        network.architecture.levels,
    )
    displacement = satellite.new_zeros(1, 4, 2)
    still = looked_at(displacement)
    for _ in range(iterations):
        places = looked_at(displacement)
        seen = _look_up(levels, places)
        displacement = displacement + _update(network.update_block_4, seen, places - still)
    return displacement


def _encode(encoder: FeatureEncoder, images: Tensor) -> Tensor:
    mean, deviation = (images.new_tensor(values)[:, None, None] for values in _IMAGENET)
    features = _normalised(encoder.conv1((images - mean) / deviation))
    for layer in (encoder.layer2, encoder.layer3):
        features = functional.max_pool2d(features, 2)
        for unit in layer:
            assert isinstance(unit, ResidualUnit)
            features = _residual(unit, features)
    encoded: Tensor = encoder.conv2(features)
    return encoded


def _residual(unit: ResidualUnit, features: Tensor) -> Tensor:
    added = _normalised(unit.conv2(_normalised(unit.conv1(features))))
    return functional.relu(functional.instance_norm(unit.downsample(features)) + added)


def _normalised(features: Tensor) -> Tensor:
    return torch.relu_(functional.instance_norm(features))


def _levels(satellite: Tensor, thermal: Tensor, count: int) -> list[Tensor]:
    """Return the thermal image's correlations ``(h * w, 1, h, w)`` with each satellite cell."""
    rows, columns = satellite.shape[-2:]
    volume = torch.relu_(torch.matmul(satellite.flatten(2).mT, thermal.flatten(2)))
    levels = [volume.reshape(rows * columns, 1, rows, columns)]
    for _ in range(count - 1):
        levels.append(functional.avg_pool2d(levels[-1], 2))
    return levels


def _look_up(levels: list[Tensor], places: Tensor) -> Tensor:
    """Sample 9 by 9 places about each of ``(1, h, w, 2)`` one by one: ``(1, C, h, w)``."""
    _, rows, columns, _ = places.shape
    steps = torch.arange(-RADIUS, RADIUS + 1.0)
    offsets = torch.stack(torch.meshgrid(steps, steps, indexing="ij"), dim=-1)
    looked = []
    for number, level in enumerate(levels):
        last = torch.tensor([level.shape[3] - 1, level.shape[2] - 1])
        around = places.reshape(-1, 1, 1, 2) / 2**number + offsets
        sampled = functional.grid_sample(level, 2.0 * around / last - 1.0, align_corners=True)
        looked.append(sampled.reshape(1, rows, columns, -1))
    return torch.cat(looked, dim=-1).movedim(-1, 1).contiguous()


def _update(block: UpdateBlock, seen: Tensor, flow: Tensor) -> Tensor:
    features = torch.cat([seen, flow.movedim(-1, 1)], dim=1)
    for layer in block.cnn.children():
        assert isinstance(layer, nn.Sequential)
        for step in layer:
            is_pooling = isinstance(step, MaxHalved)
            features = functional.max_pool2d(features, 2) if is_pooling else step(features)
    return features.flatten(2).mT
