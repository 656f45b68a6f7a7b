"""Weights from the Hugging Face hub, through its own client (an extra), pinned by hash.

Nothing is known here of what the authors' repository will hold, so the first pull is trusted and
recorded: commit and SHA-256 of every file. Later pulls take that commit and must give those bytes.
"""

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from uasthn_cli.errors import MissingExtraError, WeightsError

REPOSITORIES = {"uasthn": "xjh19972/UASTHN"}
"""What ``uasthn models pull`` knows by name; any other OWNER/REPOSITORY can be given."""

CONFIG_FILE, SAFETENSORS_FILE, PICKLED_FILE = (
    "config.json",
    "model.safetensors",
    "pytorch_model.bin",
)
"""The authors' Hugging Face layout. The third is read as plain tensors or not at all."""

_NEWEST = "main"
_COMMIT = re.compile(r"[0-9a-f]{40}")


@dataclass(frozen=True, slots=True)
class Pulled:
    """A snapshot in the cache: its folder, commit, and the SHA-256 of each file by name."""

    folder: Path
    revision: str
    sha256: Mapping[str, str]

    @property
    def weights_file(self) -> Path:
        """The file that holds the weights."""
        name = SAFETENSORS_FILE if SAFETENSORS_FILE in self.sha256 else PICKLED_FILE
        return self.folder / name


@dataclass(frozen=True, slots=True)
class Pin:
    """What a repository must give: a commit, and the SHA-256 of each file by name."""

    revision: str
    sha256: Mapping[str, str]


def pull(
    repository: str,
    cache_dir: Path,
    *,
    pin: Pin | None = None,
    revision: str | None = None,
    sha256: str | None = None,
) -> Pulled:
    """Fetch a repository's weights, or find them in the cache, and check them.

    ``revision`` goes before the pin's; without either the newest is taken. ``sha256`` is what the
    weights' file must have.

    Raises:
        MissingExtraError: huggingface_hub is not installed.
        WeightsError: they cannot be fetched, or are not those that were asked for.
    """
    wanted = revision or (pin.revision if pin else _NEWEST)
    folder = _snapshot(repository, wanted, cache_dir, [CONFIG_FILE, SAFETENSORS_FILE])
    if not (folder / SAFETENSORS_FILE).is_file():
        folder = _snapshot(repository, wanted, cache_dir, [CONFIG_FILE, PICKLED_FILE])
    names = [n for n in (CONFIG_FILE, SAFETENSORS_FILE, PICKLED_FILE) if (folder / n).is_file()]
    pulled = Pulled(folder, folder.name, {name: sha256_of(folder / name) for name in names})
    if not pulled.weights_file.is_file():
        raise WeightsError(
            f"{repository} at {wanted} holds neither {SAFETENSORS_FILE} nor {PICKLED_FILE}"
        )
    _check(repository, pulled, pin, sha256)
    return pulled


def sha256_of(path: Path) -> str:
    """Return a file's SHA-256 in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _check(repository: str, pulled: Pulled, pin: Pin | None, sha256: str | None) -> None:
    """Refuse what is not what was asked for."""
    if _COMMIT.fullmatch(pulled.revision) is None:
        raise WeightsError(f"{repository}: the hub's client names no commit ({pulled.folder})")
    found = pulled.sha256[pulled.weights_file.name]
    if sha256 is not None and found != sha256.lower():
        raise WeightsError(
            f"{repository}: SHA-256 of {pulled.weights_file.name} is {found}, not {sha256}"
        )
    if pin is None or pin.revision != pulled.revision:
        return
    for name, expected in pin.sha256.items():
        if pulled.sha256.get(name) != expected:
            raise WeightsError(
                f"{repository}: {name} is not the file that was first pulled; delete"
                f" {pulled.folder} and pull again"
            )


def _snapshot(repository: str, revision: str, cache_dir: Path, names: list[str]) -> Path:
    """Return the cache's folder of a commit that holds those of the files that there are."""
    client = _client()
    try:
        folder = client.snapshot_download(
            repository, revision=revision, cache_dir=cache_dir, allow_patterns=names
        )
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise WeightsError(f"{repository} at {revision} cannot be pulled: {reason}") from error
    return Path(folder)


def _client() -> Any:
    try:
        return import_module("huggingface_hub")
    except ImportError as error:
        raise MissingExtraError(
            f"pulling weights needs a package that is not installed ({error}):"
            " pip install 'uasthn[hub]'"
        ) from error
