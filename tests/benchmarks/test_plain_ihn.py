"""The published formulation that costs are counted in gives the package's answers."""

import torch
from plain_ihn import locate_plainly

from uasthn_cli.matching.displacement.ihn import IhnArchitecture, IterativeHomographyNetwork


def test_the_reference_answers_as_the_network_does() -> None:
    torch.manual_seed(0)
    small = IhnArchitecture(levels=2, block_widths=(8, 8), feature_channels=16, update_channels=8)
    network = IterativeHomographyNetwork(small).eval()
    satellite, thermal = torch.rand(2, 1, 3, 256, 256)
    with torch.inference_mode():
        plain = locate_plainly(network, satellite, thermal, iterations=3)
        ours = network(satellite, thermal, 3).last
    assert float(ours.abs().max()) > 0.01
    assert torch.allclose(plain, ours, atol=1e-4)
