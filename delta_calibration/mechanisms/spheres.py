"""Where three spheres meet, in symbols: the direct problem of a platform that only translates."""

from __future__ import annotations

from delta_calibration.model.symbols import Symbol, cross, dot, sqrt, square, where


def lower_meeting_point(
    centres: tuple[Symbol, Symbol, Symbol],
    radii: tuple[Symbol, Symbol, Symbol],
    way_round: Symbol,
) -> Symbol:
    """The point under three centres; not a number where the spheres do not meet.

    Args:
        centres: (3) each [m].
        radii: [m].
        way_round: 1 where the centres are numbered counter-clockwise about z, -1 clockwise; see
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
    """1 where three directions are numbered counter-clockwise about z, -1 clockwise.

    Args:
        stands: cosine and sine of each.
    """
    one, two, three = stands
    across = [(end[0] - one[0], end[1] - one[1]) for end in (two, three)]
    return where(across[0][0] * across[1][1] - across[0][1] * across[1][0] > 0.0, 1.0, -1.0)
