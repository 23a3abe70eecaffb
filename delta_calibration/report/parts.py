"""Identified dimensions, their correlations, and the combinations that are not identifiable."""

from __future__ import annotations

import numpy as np

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

_SHOWN = 18  # largest number of dimensions in the figure
_SURE = 1.96
_TOLD = 0.2  # correlation above which the hover text names the pair
_STRONG = 40  # largest number of pairs in the table


def dimensions_figure(found: Identification) -> Figure:
    """Figure of the deviations from the drawing over the tolerances, most significant first."""
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
        f"The {len(order)} most significant of {len(items)} dimensions in units of their "
        "tolerances (one "
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
    """Figure of the standard error of each kind of dimension over its tolerance."""
    geometry = found.chain.layout.geometry
    ratio = found.std[geometry] / found.parameters.prior[geometry]
    causes = [p.cause for p in found.parameters.items[geometry]]
    names = list(dict.fromkeys(causes))
    mean = np.array([np.mean(ratio[[c == name for c in causes]]) for name in names])
    place = np.arange(len(names), dtype=float)
    return Figure(
        "set_by_data",
        "What the data determine",
        "Standard error of each kind of dimension divided by its tolerance: near 0 the data "
        "determine it, near 1 only its tolerance limits it.",
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
    """Figure of the correlations of all estimates with a standard error above zero."""
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
        f"All {len(kept)} parameters in the order of the calibration file. A dark pair off the "
        "diagonal is only determined in combination.",
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
    """Table of the pairs of estimates with a correlation beyond 0.95."""
    pairs = found.correlations[:_STRONG]
    return Table(
        "correlations_table",
        "Strongly correlated estimates",
        ("parameter", "with", "correlation"),
        tuple((spoken(a), spoken(b), f"{r:+.3f}".replace("-", "−")) for a, b, r in pairs),
        "Correlations beyond ±0.95." if pairs else "No correlation beyond ±0.95.",
        words=(0, 1),
    )


def unset_table(found: Identification) -> Table:
    """Table of the parameter combinations that are determined by the priors, not by the data."""
    seen = found.observability
    return Table(
        "not_set_by_the_data",
        "What the data do not determine",
        ("combination",),
        tuple((_reworded(r.sentence()),) for r in seen.redundancies),
        f"Rank {seen.rank} of {seen.columns} parameters, including tracker frame and reflector "
        "offset. These combinations are determined by the tolerances alone; the predictions do "
        "not depend on them.",
    )


def _reworded(sentence: str) -> str:
    return spoken(sentence).replace("-", "−")


def indices_table(found: Identification) -> Table:
    """Table of the observability indices."""
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
