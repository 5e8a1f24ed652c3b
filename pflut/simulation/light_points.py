"""The grid of light values that lies over every surface."""

from __future__ import annotations

import numpy as np

from pflut.geometry import FloatArray
from pflut.simulation import raster

TEXEL = 0.22  # metres between light values
LARGEST_GRID = 48


def light_points(surfaces: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lay a grid of light values over every surface.

    Parameters
    ----------
    surfaces : ndarray of shape (n, raster.COLUMNS)

    Returns
    -------
    surfaces : ndarray of shape (n, raster.COLUMNS)
        A copy with the columns of the light maps filled in.
    points, normals : ndarray of shape (l, 3)
        Of the grid points, a little in front of the surfaces; the normal of a surface with two
        sides is zero.
    """
    result = surfaces.copy()
    points, normals = [], []
    total = 0
    for row in result:
        kind = row[raster.KIND]
        sizes = _sizes(row)
        nu, nv = (int(np.clip(np.ceil(s / TEXEL) + 1, 2, LARGEST_GRID)) for s in sizes)
        if kind in (raster.CYLINDER, raster.SPHERE):
            nu, nv = 7, 2 if kind == raster.CYLINDER else 4
        row[raster.LIGHT : raster.LIGHT_V + 1] = total, nu, nv
        total += nu * nv
        u, v = np.meshgrid(np.linspace(0.0, 1.0, nu), np.linspace(0.0, 1.0, nv))
        place, normal = _places(row, u.ravel(), v.ravel(), sizes)
        points.append(place)
        normals.append(normal)
    if not points:
        return result, np.empty((0, 3)), np.empty((0, 3))
    return result, np.concatenate(points), np.concatenate(normals)


def _sizes(row: FloatArray) -> tuple[float, float]:
    """Give a surface's extent along u and v in metres."""
    kind, length, size = row[raster.KIND], row[raster.LENGTH], row[raster.SIZE]
    if kind == raster.CYLINDER:
        return 2.0 * np.pi * length, size
    if kind == raster.SPHERE:
        return 2.0 * np.pi * length, np.pi * size
    if kind == raster.DISC:
        return 2.0 * length, 2.0 * length
    return length, size


def _places(
    row: FloatArray, u: FloatArray, v: FloatArray, sizes: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Give points and normals of a surface at fractions (u, v) of its extent."""
    kind = row[raster.KIND]
    x, y, z = row[raster.X], row[raster.Y], row[raster.Z]
    axis_u = np.array([row[raster.UX], row[raster.UY], 0.0])
    axis_v = np.array([-row[raster.UY], row[raster.UX], 0.0])
    up = np.array([0.0, 0.0, 1.0])
    # stay clear of the edges, where another surface begins
    inset = [min(0.02, 0.2 * size) / size for size in sizes]
    s = np.clip(u, inset[0], 1.0 - inset[0])[:, None]
    t = np.clip(v, inset[1], 1.0 - inset[1])[:, None]
    origin = np.array([x, y, z])
    if kind == raster.QUAD:
        places = origin + s * sizes[0] * axis_u + (1.0 - t) * sizes[1] * up
        facing = row[raster.FACING]
        normal = np.broadcast_to(-axis_v * facing, places.shape)
    elif kind in (raster.RECTANGLE, raster.DISC):
        start = 0.0 if kind == raster.RECTANGLE else 0.5
        places = origin + (s - start) * sizes[0] * axis_u + (t - start) * sizes[1] * axis_v
        normal = np.broadcast_to(up * row[raster.FACING], places.shape)
    else:
        angle = 2.0 * np.pi * u[:, None] - np.pi
        around = np.cos(angle) * axis_u + np.sin(angle) * axis_v
        if kind == raster.CYLINDER:
            normal = around
            places = origin + row[raster.LENGTH] * around + (1.0 - t) * sizes[1] * up
        else:
            polar = np.pi * v[:, None]
            normal = np.sin(polar) * around + np.cos(polar) * up
            places = origin + normal * np.array(
                [row[raster.LENGTH], row[raster.LENGTH], row[raster.SIZE]]
            )
    return places + 0.012 * normal, np.array(normal)
