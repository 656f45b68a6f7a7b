"""The architecture: imports point downwards only, and some libraries have one home."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "uasthn_cli"

LAYERS = (
    {"errors", "types", "config", "version"},
    {"geometry", "seam"},
    {"ingest", "mapping", "matching", "fusion", "uncertainty", "outputs", "report"},
    {"pipeline"},
    {"synth", "calibration", "datasets.samples"},
    {"training"},
    {"datasets"},
    {"evaluation"},
    {"commands"},
    {"__main__"},
)
"""Rooms from the lowest to the highest, ``room.module`` where one module lies lower than its room.

What a source of pairs yields is what training takes; sources that render use its data engine.
"""

LAYER_OF = {room: layer for layer, rooms in enumerate(LAYERS) for room in rooms}

HOMES = {
    "pyproj": ("geometry/geodesy.py",),
    "pymavlink": ("ingest/mavlink.py",),
    "rasterio": ("mapping/", "synth/"),
    "matplotlib": ("report/drawing.py",),
    "h5py": ("datasets/boson.py",),
    "torch": ("matching/", "training/"),
    "onnx": ("matching/onnx_graph.py",),
    "onnxruntime": ("matching/encoders.py",),
    "threadpoolctl": ("pipeline/parallel.py",),
    "click": ("commands/",),
    "rich": ("commands/",),
}
"""Libraries that only these files or folders may import."""

SOURCES = sorted(path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py"))


def imported_modules(source: str) -> Iterator[str]:
    """Yield the dotted names a module imports anywhere, ``a.b`` for ``from a import b``."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports hide which room is meant"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def room_of(relative_path: str) -> str:
    """Return the room of a file: its folder under the package, or its own name."""
    return relative_path.split("/", maxsplit=1)[0].removesuffix(".py")


def layer_of(dotted: str) -> int | None:
    """Return the layer of ``room.module…``: the module's own if it has one, else its room's."""
    room, *rest = dotted.split(".")
    return LAYER_OF.get(".".join([room, *rest[:1]]), LAYER_OF.get(room))


def violations(relative_path: str, source: str) -> list[str]:
    """Return what a file imports against the rules."""
    room = room_of(relative_path)
    own_layer = layer_of(relative_path.removesuffix(".py").replace("/", "."))
    assert own_layer is not None
    found = []
    for name in imported_modules(source):
        library, _, rest = name.partition(".")
        if library == "uasthn_cli":
            layer = layer_of(rest)
            if layer is not None and rest.split(".")[0] != room and layer >= own_layer:
                found.append(f"{relative_path} (layer {own_layer}) imports {name}")
        elif library in HOMES and not relative_path.startswith(HOMES[library]):
            found.append(f"{relative_path} imports {library}, whose home is {HOMES[library]}")
    return found


def test_every_room_has_a_layer() -> None:
    rooms = {room_of(path) for path in SOURCES} - {"__init__"}
    assert rooms <= set(LAYER_OF)


def test_training_may_take_what_sources_of_pairs_yield() -> None:
    assert (
        violations("training/loop.py", "from uasthn_cli.datasets.samples import MatchDataset") == []
    )


@pytest.mark.parametrize("relative_path", [path for path in SOURCES if path != "__init__.py"])
def test_imports_point_downwards(relative_path: str) -> None:
    assert violations(relative_path, (PACKAGE / relative_path).read_text("utf-8")) == []


@pytest.mark.parametrize(
    ("relative_path", "source"),
    [
        ("mapping/reader.py", "from uasthn_cli.ingest.frames import list_frames"),
        ("geometry/pixels.py", "from uasthn_cli import pipeline"),
        ("pipeline.py", "def f():\n    import uasthn_cli.training.loop"),
        ("synth/flight.py", "from uasthn_cli.training import scenes"),
        ("datasets/samples.py", "from uasthn_cli.training import scenes"),
        ("training/loop.py", "from uasthn_cli.datasets.rendered import RenderedDataset"),
        ("outputs/table.py", "import torch.nn"),
        ("ingest/frames.py", "from pymavlink import mavutil"),
        ("fusion/offsets.py", "from uasthn_cli.matching.search import posterior_mass"),
        ("uncertainty/decide.py", "from uasthn_cli.fusion.offsets import ce90_of"),
        ("fusion/offsets.py", "import torch"),
    ],
)
def test_the_rules_are_noticed(relative_path: str, source: str) -> None:
    assert len(violations(relative_path, source)) == 1
