"""Height maps: 16-bit PNG and GeoTIFF as ground in metres, resampled to the grid of free space."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from scipy import ndimage

from worlds.places.place import Found, Place
from worlds.terrain.heightfield import Array, Heightfield, Mask

MOST_HOLES = 0.25
"""Largest share of the area without heights."""
DEEP_HOLE = 1.5
"""Cells: ground farther than this from the nearest height is blocked."""
MOST_PIXELS = 200_000_000
COARSEST = 0.05
"""m: largest height step of a map of 8 bits; with larger steps the ground would consist of terraces."""
LINEAR_UNITS = {9001: 1.0, 9002: 0.3048, 9003: 1200 / 3937}
"""EPSG code of a unit of length → m."""


@dataclass(frozen=True, eq=False)
class Relief:
    """ground: heights of a place. holes (rows, columns): grid points without a height. window: (left, top, right, bottom), shares of the map's sides.

    found: values read from the file. notes: lines for the user.
    """

    ground: Heightfield
    holes: Mask
    window: tuple[float, float, float, float]
    found: Found
    notes: list[str]


@dataclass(frozen=True, eq=False)
class _Raster:
    """heights (rows, columns) m, NaN where unknown, row 0 in the north. pixel: m per pixel along x and y. found: values read from the file."""

    heights: Array
    pixel: tuple[float, float]
    found: Found = field(default_factory=dict)


def read_height_map(place: Place) -> Relief:
    """The relief of a height map. x and y are from the middle of the map; the lowest height of the place is 0 m.

    Raises ValueError, which says what to change, for a file that cannot be read, lacks metres, or has too many holes.
    """
    raster = _read_png(place) if place.source.suffix.lower() == ".png" else _read_tiff(place)
    rows, columns = raster.heights.shape
    dx, dy = raster.pixel
    whole = np.array([[-columns * dx / 2, -rows * dy / 2], [columns * dx / 2, rows * dy / 2]])
    area = whole if place.area is None else np.clip(np.reshape(place.area, (2, 2)), *whole)
    sides = area[1] - area[0]
    if not (sides >= 3.0).all():
        told = "" if place.area is None else f", whose height map covers {whole[0, 0]:.4g}:{whole[0, 1]:.4g}:{whole[1, 0]:.4g}:{whole[1, 1]:.4g}"
        raise ValueError(f"{place.source}: the place is {sides[0]:.3g} x {sides[1]:.3g} m, needs at least 3 m a side (size=, area=){told}")
    spacing = place.grid_spacing(float(sides.max()))
    count = np.maximum(np.floor(sides / spacing + 1e-6).astype(int) + 1, 2)
    x, y = area[0, 0] + spacing * np.arange(count[0]), area[0, 1] + spacing * np.arange(count[1])
    # The centre of the first pixel is half a pixel from the corner of the map.
    u, v = (x - whole[0, 0]) / dx - 0.5, (whole[1, 1] - y) / dy - 0.5
    heights, holes = _sampled(raster, (v, u), spacing)
    share = float(holes.mean())
    if share > MOST_HOLES:
        raise ValueError(f"{place.source}: {share:.0%} of the place has no height, needs at most {MOST_HOLES:.0%}; crop it with area=X0:Y0:X1:Y1")
    low = float(heights.min())
    notes = [f"{place.source.name}: {sides[0]:.4g} x {sides[1]:.4g} m, {np.ptp(heights):.3g} m high, a height every {spacing:.3g} m"]
    if holes.any():
        notes.append(f"{share:.1%} of it has no height; it is filled from beside, and nobody walks on what is more than {DEEP_HOLE:g} cells off one")
    found = raster.found | {"found_lowest": low}
    window = (area[0, 0], -area[1, 1], area[1, 0], -area[0, 1])
    half = whole[1, [0, 1, 0, 1]]
    shares = [float(0.5 + 0.5 * edge / side) for edge, side in zip(window, half, strict=True)]
    ground = Heightfield(heights - low, np.array([x[0], y[0]]), spacing)
    deep = ndimage.distance_transform_edt(holes) > DEEP_HOLE if holes.any() else holes
    return Relief(ground, deep, (shares[0], shares[1], shares[2], shares[3]), found, notes)


def _sampled(raster: _Raster, at: tuple[Array, Array], spacing: float) -> tuple[Array, Mask]:
    """Heights at rows and columns of pixels, and a mask of missing ones. Finer pixels are averaged over a cell; coarser ones get a cubic spline."""
    z, holes = raster.heights, np.isnan(raster.heights)
    if holes.all():
        raise ValueError("the height map has no heights at all")
    if holes.any():
        z = z[tuple(ndimage.distance_transform_edt(holes, return_distances=False, return_indices=True))]
    window = [max(1, round(spacing / pixel)) for pixel in raster.pixel[::-1]]
    z = ndimage.uniform_filter(z, window, mode="nearest")
    grid = np.meshgrid(*at, indexing="ij")
    # Where pixels are larger than cells, a cubic spline avoids creases at the pixels.
    order = 3 if max(window) == 1 else 1
    heights = ndimage.map_coordinates(z, grid, order=order, mode="nearest")
    return heights, ndimage.map_coordinates(holes.astype(np.float64), grid, order=1, mode="nearest") > 0.5


def _read_png(place: Place) -> _Raster:
    path = place.source
    size, low, high = place.size, place.low, place.high
    if size is None or low is None or high is None:
        raise ValueError(f"{path}: a PNG has no metres, needs size, low, high, as {path.name}:size=60,low=0,high=6")
    try:
        with Image.open(path, formats=["PNG"]) as image:
            if image.width * image.height > MOST_PIXELS:
                raise ValueError(f"{path}: {image.width} x {image.height} px, needs at most {MOST_PIXELS:g}")
            if image.mode not in ("I;16", "I;16B", "I", "L"):
                raise ValueError(f"{path}: is a picture in color ({image.mode}), needs one channel of 16 bits; colors go in with texture=")
            values = np.asarray(image).astype(np.float64)
            # Heights are stretched over the values that are there.
            if image.mode == "L" and (step := (high - low) / max(float(np.ptp(values)), 1.0)) > COARSEST:
                raise ValueError(f"{path}: has 8 bits, so that {high - low:g} m are in steps of {step:.2g} m, needs 16 bits")
    except (OSError, SyntaxError, Image.DecompressionBombError) as error:
        raise ValueError(f"{path}: no PNG that can be read ({error})") from None
    pixel = size / max(values.shape)
    return _Raster(_scaled(values, low, high), (pixel, pixel))


def _scaled(values: Array, low: float | None, high: float | None) -> Array:
    """Values (rows, columns) m mapped linearly, so that the lowest is `low` and the highest `high`, m. One of them alone shifts all values."""
    least, most = float(np.nanmin(values)), float(np.nanmax(values))
    if low is None or high is None:
        return values + (0.0 if low is None else low - least) + (0.0 if high is None else high - most)
    return low + (values - least) * ((high - low) / (most - least) if most > least else 0.0)


def _read_tiff(place: Place) -> _Raster:
    path = place.source
    try:
        import tifffile
    except ImportError:
        raise ValueError(f"{path}: reading GeoTIFF needs the extra places: pip install 'pilsim[places]'") from None
    try:
        with tifffile.TiffFile(path) as file:
            page: Any = file.pages[0]
            if int(np.prod(page.shape)) > MOST_PIXELS:
                raise ValueError(f"{path}: has {np.prod(page.shape):g} values, needs at most {MOST_PIXELS:g}; crop it before")
            values, tags = np.squeeze(page.asarray()), dict(page.geotiff_tags or {})
            nodata = page.tags.get(42113)
    except (OSError, tifffile.TiffFileError, KeyError, IndexError, RuntimeError, NotImplementedError) as error:
        raise ValueError(f"{path}: no TIFF that can be read ({' '.join(str(error).split())[:120]})") from None
    if values.ndim != 2 or min(values.shape) < 2:
        raise ValueError(f"{path}: has values of shape {values.shape}, needs one channel of heights (colors go in with texture=)")
    heights = values.astype(np.float64)
    if nodata is not None:
        heights[heights == float(str(nodata.value).strip("\0 "))] = np.nan
    heights[~np.isfinite(heights) | (np.abs(heights) > 1e5)] = np.nan
    if np.isnan(heights).all():
        raise ValueError(f"{path}: has no height at all (all values are NaN or nodata)")
    heights *= LINEAR_UNITS.get(int(tags.get("VerticalUnitsGeoKey", 9001)), 1.0)
    return _Raster(_scaled(heights, place.low, place.high), _pixel_size(place, tags, heights.shape), _frame(tags))


def _pixel_size(place: Place, tags: dict[str, Any], shape: tuple[int, ...]) -> tuple[float, float]:
    """m per pixel along x and y, by the place's size or the tags. Raises ValueError for degrees and for missing tags."""
    if place.size is not None:
        return (place.size / max(shape),) * 2
    scale = tags.get("ModelPixelScale")
    if scale is None:
        raise ValueError(f"{place.source}: its tags give no metres, needs size=, as {place.source.name}:size=60")
    if int(tags.get("GTModelTypeGeoKey", 1)) != 1:
        raise ValueError(f"{place.source}: is in degrees, needs metres: gdalwarp -t_srs EPSG:326xx {place.source.name} OUT.tif, or size=")
    metre = LINEAR_UNITS.get(int(tags.get("ProjLinearUnitsGeoKey", 9001)), 1.0)
    return float(scale[0]) * metre, float(scale[1]) * metre


def _frame(tags: dict[str, Any]) -> Found:
    """The projected coordinate system and the corner of the map in it, where the tags give them."""
    out: Found = {}
    code = tags.get("ProjectedCSTypeGeoKey")
    if code is not None:
        out["found_crs"] = f"EPSG:{int(code)}"
    tie = tags.get("ModelTiepoint")
    if tie is not None:
        out["found_north_west_corner"] = [float(tie[3]), float(tie[4])]
    return out


def orthophoto(path: Path, window: tuple[float, float, float, float], most: int) -> Any:
    """The part (rows, columns, 3) uint8 of a picture in a window of shares, at most `most` pixels a side. ValueError for an unreadable file."""
    try:
        with Image.open(path) as image:
            left, top, right, bottom = (share * side for share, side in zip(window, image.size * 2, strict=True))
            part = image.convert("RGB").crop((round(left), round(top), max(round(right), round(left) + 1), max(round(bottom), round(top) + 1)))
            part.thumbnail((most, most))
            return np.asarray(part)
    except (OSError, SyntaxError, Image.DecompressionBombError) as error:
        raise ValueError(f"{path}: no picture that can be read ({error})") from None
