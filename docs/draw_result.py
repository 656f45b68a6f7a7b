"""Draw the picture in the README: python docs/draw_result.py FLIGHT RESULTS PICTURE.

Left: the map with the footprints of accepted (green) and rejected (orange) frames, and a line from
the logged to the estimated position. Right: accepted frames, and what the map shows in the four
corners that were found for them.
"""

import csv
import sys
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.warp import transform as warp_points

Row = dict[str, str]
Picture = NDArray[np.uint8]

CORNERS: Final = ("tl", "tr", "bl", "br")
RING: Final = [0, 1, 3, 2]
PANEL_HEIGHT_PX: Final = 720
ACCEPTED_BGR: Final = (80, 220, 80)
REJECTED_BGR: Final = (40, 140, 255)
PRIOR_BGR: Final = (255, 255, 255)
EXAMPLES: Final = 3


def read_map(path: Path) -> tuple[Picture, Any]:
    """Return the map as BGR and its open dataset."""
    dataset = rasterio.open(path)
    bands = dataset.read((1, 2, 3))
    return np.ascontiguousarray(np.moveaxis(bands[::-1], 0, -1)), dataset


def to_map_px(dataset: Any, lat_lon: NDArray[np.float64]) -> NDArray[np.float64]:
    """Map degrees ``(n, 2)`` to points of the map ``(n, 2)``, pixel centres on whole numbers."""
    xs, ys = warp_points("EPSG:4326", dataset.crs, lat_lon[:, 1], lat_lon[:, 0])
    a, b, c, d, e, f = tuple(~dataset.transform)[:6]
    x, y = np.array(xs), np.array(ys)
    return np.stack([a * x + b * y + c, d * x + e * y + f], axis=-1) - 0.5


def points_of(row: Row, dataset: Any) -> dict[str, NDArray[np.float64]]:
    """Return corners ``(4, 2)``, estimated and logged position of a row, in map pixels."""
    names = [*CORNERS, "", "prior"]
    keys = [(f"{n}_lat", f"{n}_lon") if n else ("lat", "lon") for n in names]
    degrees = np.array([[float(row[lat]), float(row[lon])] for lat, lon in keys])
    points = to_map_px(dataset, degrees)
    return {"corners": points[:4], "estimate": points[4], "prior": points[5]}


def draw_map(picture: Picture, rows: list[Row], dataset: Any) -> Picture:
    """Return the part of the map that was flown over, with what was found."""
    scale = 2.0
    drawn = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR)
    everything = []
    for row in rows:
        points = points_of(row, dataset)
        ring = points["corners"][RING]
        everything.append(ring)
        colour = ACCEPTED_BGR if row["accepted"] == "true" else REJECTED_BGR
        outline = np.rint(ring * scale).astype(np.int32)
        cv2.polylines(drawn, [outline], True, colour, 2, cv2.LINE_AA)
        start, end = (tuple(map(int, points[k] * scale)) for k in ("prior", "estimate"))
        cv2.line(drawn, start, end, PRIOR_BGR, 2, cv2.LINE_AA)
        cv2.circle(drawn, start, 6, PRIOR_BGR, 2, cv2.LINE_AA)
        cv2.circle(drawn, end, 5, colour, -1, cv2.LINE_AA)
    reached = np.concatenate(everything) * scale
    left, top = np.maximum(reached.min(axis=0) - 30, 0).astype(int)
    right, bottom = (reached.max(axis=0) + 30).astype(int)
    return drawn[top:bottom, left:right]


def draw_pair(picture: Picture, frame_path: Path, row: Row, dataset: Any) -> Picture:
    """Return a frame beside the piece of map that lies in its four corners."""
    frame = cv2.imread(str(frame_path), cv2.IMREAD_COLOR)
    height, width = frame.shape[:2]
    right, bottom = width - 1.0, height - 1.0
    corners = np.array([[0, 0], [right, 0], [0, bottom], [right, bottom]], np.float32)
    found = points_of(row, dataset)["corners"].astype(np.float32)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    map_from_frame = cv2.getPerspectiveTransform(corners, found)
    seen = cv2.warpPerspective(picture, map_from_frame, (width, height), flags=flags)
    return np.concatenate([frame, seen], axis=1)


def fit_height(picture: Picture, height_px: int) -> Picture:
    """Return a picture scaled to a height."""
    width_px = round(picture.shape[1] * height_px / picture.shape[0])
    return cv2.resize(picture, (width_px, height_px), interpolation=cv2.INTER_AREA)


def main(flight: Path, results: Path, target: Path) -> None:
    """Draw and write the picture."""
    picture, dataset = read_map(flight / "map.tif")
    with (results / "frames.csv").open(newline="", encoding="utf-8") as handle:
        rows = [row for row in csv.DictReader(handle) if row["lat"]]
    accepted = [row for row in rows if row["accepted"] == "true"]
    chosen = accepted[:: max(1, len(accepted) // EXAMPLES)][:EXAMPLES]
    pairs = [draw_pair(picture, flight / "frames" / r["frame"], r, dataset) for r in chosen]
    column = fit_height(np.concatenate(pairs), PANEL_HEIGHT_PX)
    overview = fit_height(draw_map(picture, rows, dataset), PANEL_HEIGHT_PX)
    gap = np.full((PANEL_HEIGHT_PX, 12, 3), 255, np.uint8)
    drawn = np.concatenate([overview, gap, column], axis=1)
    cv2.imwrite(str(target), drawn, [cv2.IMWRITE_JPEG_QUALITY, 85])


if __name__ == "__main__":
    main(*(Path(argument) for argument in sys.argv[1:4]))
