"""``uasthn models``: what weights there are, what they hold, and whence to get more."""

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from uasthn_cli.commands.console import say
from uasthn_cli.commands.main import verbosity_options
from uasthn_cli.errors import OutputError, WeightsError

if TYPE_CHECKING:
    from uasthn_cli.matching.displacement.model import DisplacementModel
    from uasthn_cli.matching.hub import Pin

LOCK_FILE: Final = "models.lock.json"

_EXAMPLES: Final = """\
\b
The authors' weights, once from the hub and from the cache ever after:
  uasthn models pull uasthn
  uasthn geotag ... --estimator sthn --weights FOLDER_THAT_PULL_PRINTED
\b
A checkpoint of theirs that you have as a file:
  uasthn models info STHN_best_model.pth
  uasthn models convert STHN_best_model.pth sthn.safetensors
"""

_PATH: Final = click.Path(path_type=Path)


@click.group(epilog=_EXAMPLES, short_help="List, describe, fetch and convert weights.")
def models() -> None:
    """List, describe, fetch and convert the weights of networks.

    No file is ever unpickled: a checkpoint that holds anything but plain tensors is refused.
    """


@models.command("list", params=verbosity_options())
@click.option("--cache", "cache_dir", type=_PATH, metavar="DIR", help="See `uasthn models pull`.")
def list_models(cache_dir: Path | None) -> None:
    """List the weights in the box, and those that can be pulled."""
    from uasthn_cli.matching.hub import REPOSITORIES
    from uasthn_cli.matching.inventory import bundled, describe

    click.echo("In the box:")
    for path in bundled():
        info = describe(path)
        size = _size(info.size_bytes)
        click.echo(f"  {path.stem:<10}{info.estimator:<8}{info.layout:<18}{size:<10}{path}")
    click.echo("To pull (uasthn models pull NAME), for dhn, ihn and sthn with --weights:")
    lock = _lock_path(cache_dir)
    for name, repository in REPOSITORIES.items():
        pin = _read_lock(lock).get(repository)
        state = f"pulled at {pin['revision'][:12]}" if pin else "not pulled yet"
        click.echo(f"  {name:<10}https://huggingface.co/{repository} ({state})")


@models.command(params=verbosity_options())
@click.argument("file", type=_PATH)
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object.")
def info(file: Path, as_json: bool) -> None:
    """Say what a file of weights holds: network, layout, size and hash.

    FILE is a .safetensors file, an authors' checkpoint (.pth), or a Hugging Face folder.
    """
    from uasthn_cli.matching.inventory import describe

    found = describe(file)
    rows: dict[str, Any] = {
        "file": str(found.file),
        "estimator": found.estimator,
        "layout": found.layout,
        "size_bytes": found.size_bytes,
        "sha256": found.sha256,
        "parameters": found.parameters,
        "architecture": dict(found.architecture),
        "notes": dict(found.notes),
    }
    if as_json:
        click.echo(json.dumps(rows, indent=2, ensure_ascii=False, sort_keys=True))
        return
    rows["size_bytes"] = f"{found.size_bytes:,} ({_size(found.size_bytes)})"
    rows["parameters"] = f"{found.parameters:,}"
    for part in ("architecture", "notes"):
        rows |= {f"{part}: {name}": value for name, value in rows.pop(part).items()}
    width = max(map(len, rows)) + 2
    for name, value in rows.items():
        click.echo(f"{name:<{width}}{value}")


@models.command(params=verbosity_options())
@click.argument("name", metavar="NAME")
@click.option(
    "--revision",
    metavar="COMMIT",
    help="Take this commit.  [default: the one first pulled; on the first pull the newest]",
)
@click.option(
    "--sha256",
    metavar="HEX",
    help="Refuse weights with another hash.  [default: that of the first pull, which takes any]",
)
@click.option(
    "--cache",
    "cache_dir",
    type=_PATH,
    metavar="DIR",
    help="Where weights are kept.  [default: $XDG_CACHE_HOME/uasthn or ~/.cache/uasthn]",
)
def pull(name: str, revision: str | None, sha256: str | None, cache_dir: Path | None) -> None:
    """Fetch weights from the Hugging Face hub and print the folder to give to --weights.

    NAME is `uasthn` (the authors' xjh19972/UASTHN) or any OWNER/REPOSITORY of that layout.

    Trust on first use: this program cannot know the authors' hashes, so the first pull records the
    commit and the SHA-256 of each file in models.lock.json beside the cache. Later pulls take that
    commit, from the cache without any network, and refuse other bytes. Give --revision and --sha256
    to trust nothing but what you have from the authors; --revision also replaces what is recorded.
    """
    from uasthn_cli.matching.displacement.checkpoints import load_displacement
    from uasthn_cli.matching.hub import REPOSITORIES, Pin
    from uasthn_cli.matching.hub import pull as pull_from_hub

    repository = REPOSITORIES.get(name, name)
    if repository.count("/") != 1:
        raise click.UsageError(
            f"{name!r} is neither OWNER/REPOSITORY nor one of: {', '.join(REPOSITORIES)}"
        )
    lock = _lock_path(cache_dir)
    locked = _read_lock(lock).get(repository)
    pin = None if locked is None else Pin(locked["revision"], locked["sha256"])
    pulled = pull_from_hub(
        repository, lock.parent / "hub", pin=pin, revision=revision, sha256=sha256
    )
    model = load_displacement(pulled.folder)
    found = Pin(pulled.revision, pulled.sha256)
    if pin is None or pin.revision != found.revision:
        _record(lock, repository, found)
        say(f"recorded commit {found.revision} and its hashes in {lock}")
    say(f"{model.name} weights of {repository}, {pulled.weights_file.name}")
    click.echo(pulled.folder)


@models.command(params=verbosity_options())
@click.argument("source", metavar="IN", type=_PATH)
@click.argument("out", metavar="OUT", type=_PATH)
@click.option("--overwrite", is_flag=True, help="Replace what is there.")
def convert(source: Path, out: Path, overwrite: bool) -> None:
    """Write weights of dhn, ihn or sthn in another layout; numbers stay as they are.

    OUT's ending says which: `.safetensors` this program's own, `.pth` the authors' checkpoint, none
    their Hugging Face folder.
    """
    from uasthn_cli.matching.displacement.checkpoints import load_displacement
    from uasthn_cli.outputs.atomic import write_files

    if out.suffix not in (".safetensors", ".pth", ""):
        raise click.UsageError(f"{out}: OUT must end in .safetensors, .pth or nothing (a folder)")
    if out.exists() and not overwrite:
        raise OutputError(f"{out}: exists already; give --overwrite to replace it")
    model = load_displacement(source)
    files = _converted(model, out)
    try:
        files[0][0].parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{out}: cannot be written ({error.strerror or error})") from error
    write_files(files)
    say(f"{model.name} weights are in {out}")


def _converted(model: "DisplacementModel", out: Path) -> list[tuple[Path, bytes]]:
    """Return the files to write."""
    from uasthn_cli.matching.displacement.checkpoints import (
        serialise_checkpoint,
        serialise_folder,
        serialise_model,
    )

    if out.suffix == ".safetensors":
        return [(out, serialise_model(model))]
    if out.suffix == ".pth":
        return [(out, serialise_checkpoint(model))]
    return [(out / name, content) for name, content in serialise_folder(model).items()]


def _lock_path(cache_dir: Path | None) -> Path:
    """Return the lock file, beside the cache."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return (cache_dir or Path(home) / "uasthn") / LOCK_FILE


def _read_lock(path: Path) -> dict[str, Any]:
    """Return what was pulled, by repository."""
    if not path.is_file():
        return {}
    try:
        lock = json.loads(path.read_text("utf-8"))
        return {
            repository: {"revision": str(entry["revision"]), "sha256": dict(entry["sha256"])}
            for repository, entry in lock.items()
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise WeightsError(f"{path}: damaged; delete it to trust the next pull anew") from error


def _record(path: Path, repository: str, pin: "Pin") -> None:
    """Add what was pulled to the lock file."""
    from uasthn_cli.outputs.atomic import write_text

    entry = {"revision": pin.revision, "sha256": dict(pin.sha256)}
    lock = _read_lock(path) | {repository: entry}
    write_text(path, json.dumps(lock, indent=2, sort_keys=True) + "\n")


def _size(size_bytes: int) -> str:
    return f"{size_bytes / 1e6:.1f} MB"
