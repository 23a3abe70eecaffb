"""Where three spheres meet, in symbols: the direct problem of a platform that only translates."""

from __future__ import annotations

from delta_calibration.model.symbols import Symbol, cross, dot, sqrt, square


def lower_meeting_point(
    centres: tuple[Symbol, Symbol, Symbol], radii: tuple[Symbol, Symbol, Symbol]
) -> Symbol:
    """The point on the far side of (c2 - c1) x (c3 - c1): under elbows at 0, 120, 240 degrees.

    Not a number where the spheres do not meet.
    """
    a, b = centres[1] - centres[0], centres[2] - centres[0]
    normal = cross(a, b)
    size = square(normal)
    da = (dot(a, a) + radii[0] ** 2 - radii[1] ** 2) / 2
    db = (dot(b, b) + radii[0] ** 2 - radii[2] ** 2) / 2
    foot = cross(da * b - db * a, normal) / size
    rise = sqrt((radii[0] ** 2 - square(foot)) / size)
    return centres[0] + foot - rise * normal
