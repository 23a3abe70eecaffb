"""The swarm of compensation/apso.py in a straightforward form: plain Python, one target.

It uses lists and `math` and no arrays, as the reference for the benefit of compilation. The law
and its constants are the same; the random numbers are Python's own.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence

from delta_calibration.compensation import ApsoSettings

Vector = list[float]


def meeting_point(spheres: Sequence[Sequence[float]], q: Vector) -> Vector:
    """Lower intersection of three spheres of radii l about c + u cos q + v sin q, [m].

    Raises:
        ValueError: they do not intersect.
    """
    centres = []
    for (cx, cy, cz, ux, uy, uz, vx, vy, vz, _), angle in zip(spheres, q, strict=True):
        cos, sin = math.cos(angle), math.sin(angle)
        centres.append(
            (cx + cos * ux + sin * vx, cy + cos * uy + sin * vy, cz + cos * uz + sin * vz)
        )
    (ox, oy, oz), (ax, ay, az), (bx, by, bz) = centres
    ax, ay, az, bx, by, bz = ax - ox, ay - oy, az - oz, bx - ox, by - oy, bz - oz
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    nn, r2 = nx * nx + ny * ny + nz * nz, spheres[0][9] ** 2
    da = (ax * ax + ay * ay + az * az + r2 - spheres[1][9] ** 2) / (2 * nn)
    db = (bx * bx + by * by + bz * bz + r2 - spheres[2][9] ** 2) / (2 * nn)
    gx, gy, gz = da * bx - db * ax, da * by - db * ay, da * bz - db * az
    fx, fy, fz = gy * nz - gz * ny, gz * nx - gx * nz, gx * ny - gy * nx
    rise = math.sqrt((r2 - (fx * fx + fy * fy + fz * fz)) / nn)
    return [ox + fx - rise * nx, oy + fy - rise * ny, oz + fz - rise * nz]


def inertia(places: Sequence[Vector], bound: float) -> float:
    """Inertia weight (14) of the swarm, from its entropy along the box's diagonal."""
    m = len(places)
    counts = [0] * m
    for place in places:
        along = sum(place) / (len(place) * bound)
        counts[min(max(int((along + 1) * m / 2), 0), m - 1)] += 1
    entropy = -sum(h / m * math.log(h / m) for h in counts if h) / math.log(m)
    return 1 / (1 + 1.5 * math.exp(-2.6 * entropy))


def search(
    distance: Callable[[Vector], float], joints: int, s: ApsoSettings, draw: random.Random
) -> tuple[Vector, float, int]:
    """The correction [rad] with the smallest distance [m], that distance, and the evaluations."""
    bound, most = s.bound_rad, s.velocity_fraction * 2 * s.bound_rad
    places = [[draw.uniform(-bound, bound) for _ in range(joints)] for _ in range(s.particles)]
    places[0] = [0.0] * joints
    speeds = [[0.0] * joints for _ in places]
    own, fitness = [list(place) for place in places], [math.inf] * s.particles
    evaluations = 0
    for iteration in range(s.iterations + 1):
        for i, place in enumerate(places):
            far = distance(place)
            evaluations += 1
            if far < fitness[i]:
                fitness[i], own[i] = far, list(place)
        least = min(fitness)
        leader = own[fitness.index(least)]
        if least <= s.tolerance or iteration == s.iterations:
            break
        w = inertia(places, bound)
        for place, speed, best in zip(places, speeds, own, strict=True):
            for k in range(joints):
                v = w * speed[k]
                v += s.cognitive * draw.random() * (best[k] - place[k])
                v += s.social * draw.random() * (leader[k] - place[k])
                speed[k] = min(max(v, -most), most)
                place[k] = min(max(place[k] + speed[k], -bound), bound)
    return leader, least, evaluations
