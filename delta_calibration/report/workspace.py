"""Maps of the error over the workspace before, calibrated and extended, with a common scale."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.diagnosis.judge import unabsorbed
from delta_calibration.region import Region
from delta_calibration.report.drawing import Axis, Field, Figure, Panel, Points, Scale
from delta_calibration.report.judged import Judged

Array = NDArray[np.float64]

MM = 1e3
_NODES = 71  # nodes along a side
_KERNEL = 0.25  # kernel width over the poses' spread (RMS distance from their middle)
_LEAST_KERNEL = 0.02  # [m] smallest kernel width
_FLAT = 0.01  # [m] extent above which poses spread along an axis
_ON_FACE = 1e-6  # [m] tolerance for a place on a face of the region
_SLAB = 1.0  # distance from a plane, in kernel widths, within which a pose is shown on it
_ROUND = (1.0, 2.0, 5.0, 10.0)
_DOT = "#ffffff"


def maps(
    place: Array, errors: dict[str, Array], region: Region, noise: float
) -> tuple[Figure, ...]:
    """Figures of the RMS error around each point of a plane and of a section.

    Args:
        place: positions of the poses in the base, (n, 3) [m].
        errors: errors of each model, (n,) [m].
        region: measured region; the maps are empty outside.
        noise: noise of a pose [m], used for the low end of the scale.
    """
    scale = scale_of(list(errors.values()), noise)
    width = kernel(place)
    middle = np.median(place, axis=0)
    told = (
        "Root mean square of the held-out error around each point (Gaussian kernel, "
        f"{MM * width:.0f} mm), at poses that the fit has not seen; dots are the measured poses "
        f"within {MM * _SLAB * width:.0f} mm of the plane. All maps have the same logarithmic "
        "scale."
    )
    planes = _planes(place)
    if len(planes) == 1:
        told += " The poses lie in one plane: no other is shown."
    return tuple(
        Figure(
            f"error_{name}",
            _titled(axes[2], float(middle[axes[2]])),
            told if axes == planes[-1] else "",
            tuple(
                _panel(model, place, error, region, scale, axes, float(middle[axes[2]]), width)
                for model, error in errors.items()
            ),
            columns=3,
        )
        for name, axes in zip(("map", "section"), planes, strict=False)
    )


def _planes(place: Array) -> tuple[tuple[int, int, int], ...]:
    """At most two planes in which poses (n, 3) spread: their two axes and the normal axis."""
    wide = np.ptp(place, axis=0) > _FLAT
    planes = [axes for axes in ((0, 1, 2), (0, 2, 1), (1, 2, 0)) if wide[list(axes[:2])].all()]
    return tuple(planes[:2]) or ((0, 1, 2),)


def _titled(across: int, at: float) -> str:
    """Title of a plane normal to an axis."""
    name = "Seen from above" if across == 2 else "Section"
    return f"{name}, {'xyz'[across]} = {MM * at:.0f} mm".replace("-", "\u2212")


def unknown_maps(judged: Judged) -> tuple[Figure, ...]:
    """Figures of the displacement by the smooth map of the error without a known cause."""
    return tuple(
        _unknown(judged, term) for term in judged.diagnosis.model.terms if term.unexplained
    )


def _unknown(judged: Judged, term: Candidate) -> Figure:
    place, moved = unabsorbed(judged.diagnosis.model, term)
    size, width = np.linalg.norm(moved, axis=1), kernel(place)
    middle = np.median(place, axis=0)
    scale = Scale("displacement, RMS [mm]", 0.0, _up(MM * float(np.quantile(size, 0.98))))
    return Figure(
        "unknown_structure",
        "Where the error without a known cause occurs",
        "Displacement of the reflector by the smooth map of this error, without the part that "
        "another geometry and frame would absorb, around each point (Gaussian kernel, "
        f"{MM * width:.0f} mm).",
        tuple(
            _panel(
                _titled(axes[2], float(middle[axes[2]])),
                place,
                size,
                judged.region,
                scale,
                axes,
                float(middle[axes[2]]),
                width,
            )
            for axes in _planes(place)
        ),
    )


def _panel(
    model: str,
    place: Array,
    error: Array,
    region: Region,
    scale: Scale,
    axes: tuple[int, int, int],
    at: float,
    width: float,
) -> Panel:
    """Panel of one model on one plane; `axes` are the two of the plane and its normal."""
    i, j, k = axes
    x, y = (np.linspace(*_ends(place[:, axis]), _NODES) for axis in (i, j))
    nodes = np.zeros((_NODES * _NODES, 3))
    nodes[:, i], nodes[:, j] = (grid.ravel() for grid in np.meshgrid(x, y))
    nodes[:, k] = at
    value = around(nodes, place, error, width)
    low, high = (end(region.vertices[:, k]) for end in (np.min, np.max))
    nodes[:, k] = np.clip(at, low, high)  # for a flat region, off which noise moves the poses
    value[region.outside(nodes) > _ON_FACE] = np.nan
    near = np.abs(place[:, k] - at) < _SLAB * width
    told = tuple(f"{MM * e:.4f} mm" for e in error[near])
    names = "xyz"
    return Panel(
        model,
        Axis(f"{names[i]} [mm]"),
        Axis(f"{names[j]} [mm]"),
        (
            Field(model, MM * x, MM * y, MM * value.reshape(_NODES, _NODES), scale),
            Points(
                "", MM * place[near, i], MM * place[near, j], _DOT, size=5.0, told=told, edge=True
            ),
        ),
        equal=True,
        tall=_height(np.ptp(y) / np.ptp(x)),
    )


def _height(aspect: float) -> float:
    """Relative height of a panel for a plane with this ratio of height to width."""
    return float(np.clip(0.2 + 0.85 * aspect, 0.45, 1.3))


def around(nodes: Array, place: Array, error: Array, width: float) -> Array:
    """RMS of errors (n,) [m] around nodes (k, 3) [m] by a Gaussian kernel, (k,) [m]."""
    weight = np.exp(-cdist(nodes, place, "sqeuclidean") / (2 * width**2)) + 1e-12
    return np.asarray(np.sqrt(weight @ error**2 / weight.sum(axis=1)))


def kernel(place: Array) -> float:
    """Width of the kernel [m] for poses (n, 3)."""
    spread = float(np.sqrt(np.mean(np.sum((place - place.mean(axis=0)) ** 2, axis=1))))
    return max(_KERNEL * spread, _LEAST_KERNEL)


def scale_of(errors: list[Array], noise: float) -> Scale:
    """Logarithmic scale from about the noise to the largest errors, with round ends."""
    high = float(np.quantile(np.concatenate(errors), 0.99))
    low = min(float(np.quantile(errors[-1], 0.1)), noise, high / 2)
    return Scale("held-out error, RMS [mm]", _down(MM * low), _up(MM * high), log=True)


def _down(value: float) -> float:
    decade = 10.0 ** np.floor(np.log10(value))
    return float(max(r for r in _ROUND if r * decade <= value * 1.001) * decade)


def _up(value: float) -> float:
    decade = 10.0 ** np.floor(np.log10(value))
    return float(min(r for r in _ROUND if r * decade >= value * 0.999) * decade)


def _ends(values: Array) -> tuple[float, float]:
    margin = 0.02 * float(np.ptp(values)) + 1e-3
    return float(values.min()) - margin, float(values.max()) + margin
