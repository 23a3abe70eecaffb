"""The machine's dimensions as found, how they lean on each other, and what the data cannot set."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.estimation import Identification
from delta_calibration.report.document import Table
from delta_calibration.report.drawing import (
    CALIBRATED,
    GREY,
    Axis,
    Bars,
    Field,
    Figure,
    Panel,
    Points,
    Rule,
    Scale,
)
from delta_calibration.wording import figures, spoken

Array = NDArray[np.float64]

_SHOWN = 18  # dimensions
_SURE = 1.96
_TOLD = 0.2  # a correlation from which it is told whose
_STRONG = 40  # pairs in the table


def dimensions_figure(found: Identification) -> Figure:
    """Deviations from the drawing in units of the tolerances, the clearest first."""
    geometry = found.chain.layout.geometry
    items = found.parameters.items[geometry]
    prior = found.parameters.prior[geometry]
    off = (found.theta - found.parameters.nominal)[geometry] / prior
    spread = found.std[geometry] / prior
    order = np.argsort(-np.abs(off) / spread)[:_SHOWN]
    told = tuple(
        f"{spoken(items[k].name)}: {_shown(off[k] * prior[k], items[k].unit)} "
        f"± {_shown(spread[k] * prior[k], items[k].unit)}"
        for k in order
    )
    names = tuple(spoken(items[k].name) for k in order)
    return Figure(
        "dimensions",
        "Deviations from the drawing",
        f"The {len(order)} clearest of {len(items)} dimensions in units of their tolerances (one "
        "standard deviation of the parts), with 95 % intervals. Dotted: one tolerance.",
        (
            Panel(
                "",
                Axis("deviation over tolerance [1]"),
                Axis("", names=names),
                (
                    Points(
                        "",
                        off[order],
                        np.arange(len(order), dtype=float),
                        CALIBRATED,
                        size=7.0,
                        error=_SURE * spread[order],
                        told=told,
                    ),
                    *(Rule("", value, GREY, "dot", upright=True) for value in (-1.0, 1.0)),
                    Rule("", 0.0, GREY, "solid", upright=True),
                ),
                tall=max(1.0, 0.075 * len(order) + 0.3),
            ),
        ),
        columns=1,
    )


def _shown(value: float, unit: str) -> str:
    factor, name = {"m": (1e3, "mm"), "rad": (1e3, "mrad")}.get(unit, (1.0, unit))
    return f"{figures(value * factor)} {name}"


def set_by_data(found: Identification) -> Figure:
    """How much of each kind of dimension the data set: its standard error over its tolerance."""
    geometry = found.chain.layout.geometry
    ratio = found.std[geometry] / found.parameters.prior[geometry]
    causes = [p.cause for p in found.parameters.items[geometry]]
    names = list(dict.fromkeys(causes))
    mean = np.array([np.mean(ratio[[c == name for c in causes]]) for name in names])
    place = np.arange(len(names), dtype=float)
    return Figure(
        "set_by_data",
        "What the data set",
        "Standard error left of each kind of dimension over its tolerance: near 0 the data set "
        "it, near 1 only the drawing's tolerance does.",
        (
            Panel(
                "",
                Axis("standard error over tolerance [1]", low=0.0, high=1.05),
                Axis("", names=tuple(map(spoken, names))),
                (Bars("", place, mean, CALIBRATED), Rule("", 1.0, GREY, "dot", upright=True)),
            ),
        ),
    )


def correlation_figure(found: Identification) -> Figure:
    """Correlations of all estimates that the data have a say in."""
    names = found.parameters.names
    kept = np.flatnonzero(found.std > 0)
    sigma = found.std[kept]
    value = found.covariance[np.ix_(kept, kept)] / np.outer(sigma, sigma)
    place = np.arange(len(kept), dtype=float)
    scale = Scale("correlation [1]", -1.0, 1.0, diverging=True)
    called = tuple(spoken(names[k]) for k in kept)
    told = tuple(
        tuple(
            f"{a}, {b}: {r:+.2f}" if abs(r) > _TOLD else f"{r:+.2f}"
            for b, r in zip(called, row, strict=True)
        )
        for a, row in zip(called, value, strict=True)
    )
    return Figure(
        "correlations",
        "Correlations of the estimates",
        f"All {len(kept)} parameters in the order of the calibration file. Off the diagonal, dark "
        "pairs are known together rather than each.",
        (
            Panel(
                "",
                Axis("parameter [number]"),
                Axis("", names=called),
                (Field("correlation", place, place, value, scale, told),),
                equal=True,
                tall=1.5,
            ),
        ),
    )


def correlation_table(found: Identification) -> Table:
    """Pairs that lean on each other by more than 0.95."""
    pairs = found.correlations[:_STRONG]
    return Table(
        "correlations_table",
        "Estimates that lean on each other",
        ("parameter", "with", "correlation"),
        tuple((spoken(a), spoken(b), f"{r:+.3f}".replace("-", "−")) for a, b, r in pairs),
        "Beyond 0.95 either way." if pairs else "None beyond 0.95 either way.",
        words=(0, 1),
    )


def unset_table(found: Identification) -> Table:
    """Combinations that priors, not data, decide."""
    seen = found.observability
    return Table(
        "not_set_by_the_data",
        "What the data cannot set",
        ("combination",),
        tuple((_reworded(r.sentence()),) for r in seen.redundancies),
        f"Rank {seen.rank} of {seen.columns} parameters, tracker frame and reflector offset "
        "within. These are set by the tolerances alone; the predictions do not depend on "
        "them.",
    )


def _reworded(sentence: str) -> str:
    return spoken(sentence).replace("-", "−")


def indices_table(found: Identification) -> Table:
    """Observability indices."""
    meaning = {
        "O1": "geometric mean of the singular values over the root of the number of poses",
        "O2": "smallest over largest singular value",
        "O3": "smallest singular value",
        "O4": "smallest squared over largest",
    }
    return Table(
        "observability",
        "Observability",
        ("index", "meaning", "value [1]"),
        tuple((k, meaning.get(k, ""), figures(v)) for k, v in found.observability.indices.items()),
        words=(0, 1),
    )
