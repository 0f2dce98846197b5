"""Solids of revolution around the x axis and what else a cutaway is made of, as triangles.

A profile is a sequence of stations (x, inner radius, outer radius), joined by straight lines; two
stations at one x are a step. The cut plane is z = 0, what is cut away lies before it (z > 0).
"""
from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

HALF, WHOLE = np.pi, 2.0 * np.pi
FACETS = 24  # of half a turn
FORWARD = (0.0, 0.0, 1.0)

Profile = list[tuple[float, float, float]]


@dataclass(frozen=True)
class Solid:
    """Triangles: `points` and `normals` (float, n x 3), `triangles` (int, m x 3)."""

    points: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray

    def moved(self, x: float) -> Solid:
        """Return the solid shifted along the axis."""
        return Solid(self.points + [x, 0.0, 0.0], self.normals, self.triangles)


def join(solids: list[Solid]) -> Solid:
    """Return several solids as one."""
    base = np.cumsum([0] + [len(solid.points) for solid in solids[:-1]])
    return Solid(*(np.concatenate([getattr(solid, name) for solid in solids])
                   for name in ('points', 'normals')),
                 np.concatenate([solid.triangles + first
                                 for solid, first in zip(solids, base, strict=True)]))


def turned(profile: Profile, angle: float = HALF) -> Solid:
    """Return the solid of a profile: the half behind the cut, with its cut faces, or the whole."""
    parts = []
    for (x0, in0, out0), (x1, in1, out1) in pairwise(profile):
        for r0, r1, sign in ((out0, out1, 1.0), (in0, in1, -1.0)):
            if r0 > 0.0 or r1 > 0.0:
                parts.append(_skin(x0, r0, x1, r1, angle, sign))
    for (x, inner, outer), sign in ((profile[0], -1.0), (profile[-1], 1.0)):
        parts.append(_skin(x, inner, x, outer, angle, sign))
    if angle < WHOLE:
        parts.append(section(profile))
    return join(parts)


def section(profile: Profile, depth: float = 0.0) -> Solid:
    """Return the cut faces of a profile, above and below the axis, at z = -`depth`."""
    faces = []
    for (x0, in0, out0), (x1, in1, out1) in pairwise(profile):
        for side in (1.0, -1.0):
            faces.append(flat([(x0, side * in0), (x1, side * in1), (x1, side * out1),
                               (x0, side * out0)], depth))
    return join(faces)


def flat(corners: list[tuple[float, float]], depth: float = 0.0) -> Solid:
    """Return a quadrilateral of (x, y) that faces the eye, at z = -`depth`."""
    points = np.array([(x, y, -depth) for x, y in corners], dtype=float)
    return Solid(points, np.tile(FORWARD, (4, 1)), np.array([(0, 1, 2), (0, 2, 3)]))


def tube(path: np.ndarray, radius: float, facets: int = 10) -> Solid:
    """Return a wire along `path` (n x 3) with flat ends."""
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(along, [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(along, side)
    angles = np.linspace(0.0, WHOLE, facets, endpoint=False)
    normals = (np.cos(angles)[:, None] * side[:, None] + np.sin(angles)[:, None] * up[:, None])
    points = path[:, None] + radius * normals
    body = Solid(points.reshape(-1, 3), normals.reshape(-1, 3),
                 _grid(len(path), facets, closed=True))
    fan = np.array([(0, i, i + 1) for i in range(1, facets - 1)])
    ends = [Solid(points[i], np.tile(way * along[i], (facets, 1)), fan)
            for i, way in ((0, -1.0), (-1, 1.0))]
    return join([body, *ends])


def _skin(x0: float, r0: float, x1: float, r1: float, angle: float, sign: float) -> Solid:
    """Return a cone between two circles; `sign` -1 turns its normals round."""
    facets = round(FACETS * angle / HALF)
    around = np.linspace(0.0, angle, facets + 1)
    circle = np.stack([np.zeros_like(around), np.cos(around), -np.sin(around)], axis=1)
    points = np.concatenate([r * circle + [x, 0.0, 0.0] for x, r in ((x0, r0), (x1, r1))])
    slope = np.array([r0 - r1, x1 - x0]) if x1 > x0 else np.array([1.0, 0.0])
    slope = sign * slope / np.linalg.norm(slope)
    normals = slope[1] * circle + [slope[0], 0.0, 0.0]
    return Solid(points, np.tile(normals, (2, 1)), _grid(2, facets + 1, closed=False))


def _grid(rows: int, columns: int, closed: bool) -> np.ndarray:
    """Return the triangles of a net of points, each row joined to the next."""
    cells = columns if closed else columns - 1
    i, j = (part.ravel() for part in np.mgrid[0:rows - 1, 0:cells])
    here, right = i * columns + j, i * columns + (j + 1) % columns
    return np.concatenate([np.stack([here, right, here + columns], axis=1),
                           np.stack([right, right + columns, here + columns], axis=1)])
