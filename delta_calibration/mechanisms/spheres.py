"""Intersection of three spheres, in symbols: forward kinematics of a translating platform."""

from __future__ import annotations

from delta_calibration.model.symbols import Symbol, cross, dot, sqrt, square, where


def lower_meeting_point(
    centres: tuple[Symbol, Symbol, Symbol],
    radii: tuple[Symbol, Symbol, Symbol],
    way_round: Symbol,
) -> Symbol:
    """Lower intersection point of three spheres [m]; NaN where they do not intersect.

    Args:
        centres: centres of the spheres, (3) each [m].
        radii: radii of the spheres [m].
        way_round: 1 if the centres are numbered counter-clockwise about z, -1 if clockwise; see
            `way_round`.
    """
    a, b = centres[1] - centres[0], centres[2] - centres[0]
    normal = cross(a, b)
    size = square(normal)
    da = (dot(a, a) + radii[0] ** 2 - radii[1] ** 2) / 2
    db = (dot(b, b) + radii[0] ** 2 - radii[2] ** 2) / 2
    foot = cross(da * b - db * a, normal) / size
    rise = way_round * sqrt((radii[0] ** 2 - square(foot)) / size)
    return centres[0] + foot - rise * normal


def way_round(stands: tuple[tuple[Symbol, Symbol], ...]) -> Symbol:
    """Return 1 if three directions are numbered counter-clockwise about z, -1 if clockwise.

    Args:
        stands: cosine and sine of each direction.
    """
    one, two, three = stands
    across = [(end[0] - one[0], end[1] - one[1]) for end in (two, three)]
    return where(across[0][0] * across[1][1] - across[0][1] * across[1][0] > 0.0, 1.0, -1.0)
