from pathlib import Path

import pytest

from uasthn_cli.errors import WeightsError
from uasthn_cli.evaluation.members import describe_weights, open_members
from uasthn_cli.matching.registry import XCORR


def test_members_are_the_files_given_or_those_in_the_box() -> None:
    def count(*weights: Path, name: str = "xcorr", ensemble: bool = False) -> int:
        return len(open_members(name, weights, device="cpu", symmetries=1, ensemble=ensemble))

    assert count(name="ncc") == 1
    assert count(*XCORR.bundled_weights[:2]) == 2
    assert count(ensemble=True) == len(XCORR.bundled_weights) == 3
    with pytest.raises(WeightsError, match="ncc has no ensemble"):
        count(name="ncc", ensemble=True)
    with pytest.raises(WeightsError, match="leave out --weights"):
        count(XCORR.bundled_weights[0], ensemble=True)


def test_files_are_named_with_their_digest(tmp_path: Path) -> None:
    path = tmp_path / "a.safetensors"
    path.write_bytes(b"weights")
    (name,) = describe_weights([path], ensemble=False)
    file, digest = name.split("@")
    assert file == "a.safetensors"
    assert len(digest) == 12
    path.write_bytes(b"others")
    assert describe_weights([path], ensemble=False) != (name,)
    assert describe_weights([], ensemble=True) == ("ensemble in the box",)
