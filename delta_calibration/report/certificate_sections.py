"""Sections of a certificate: conditions, dimensions, points, uncertainty budget."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.report.about import NOT_STATED, About
from delta_calibration.report.budget import standard
from delta_calibration.report.certificate import COVERAGE, MM, Certificate, Dimension
from delta_calibration.report.certificate_figures import histogram_figure, vector_figure
from delta_calibration.report.decision import Decision
from delta_calibration.report.document import Section, Table
from delta_calibration.wording import NO_VALUE, figures, rounded, set_aside, spoken

Array = NDArray[np.float64]

UM = 1e6
_ALL = 100.0  # [%] of a tolerance; an incomplete model can give more, shown as this bound
_UNITS = {"m": (1e3, "mm"), "rad": (1e3, "mrad"), "m/rad": (1e3, "mm/rad")}


def conditions_section(certificate: Certificate) -> Section:
    """Section on the stated and recorded conditions of the measurement."""
    about = certificate.about
    poses = certificate.examined.poses
    warm = [
        f"{part} {np.nanmin(celsius):.1f} to {np.nanmax(celsius):.1f} °C"
        for part, celsius in zip(poses.temperature_parts, poses.temperature.T, strict=True)
        if np.isfinite(celsius).any()
    ]
    payload = np.unique(poses.payload[np.isfinite(poses.payload)])
    load = ", ".join(f"{value:g}" for value in payload[:6]) + " kg" if payload.size else ""
    rows = (
        ("customer", about.text("customer")),
        ("place of calibration", about.text("place")),
        ("conditions", about.text("conditions")),
        ("ambient temperature", _unit(about, "°C", "ambient", "temperature_c")),
        ("its standard uncertainty", _unit(about, "K", "ambient", "u_temperature_k")),
        ("expansion of the machine", _unit(about, "µm/(m K)", "machine", "expansion_um_per_m_k")),
        ("humidity", _unit(about, "%", "ambient", "humidity_percent")),
        ("air pressure", _unit(about, "hPa", "ambient", "pressure_hpa")),
        ("temperatures recorded", ", ".join(warm) or "none"),
        ("payloads recorded", load or "none"),
        ("duration", f"{poses.duration / 60:.0f} min"),
        ("readings set aside", _aside(certificate)),
        ("poses set aside", _poses_aside(certificate)),
    )
    return Section(
        "conditions", "Conditions", (), (Table("conditions", "", ("", ""), rows, words=(0, 1)),)
    )


def _aside(certificate: Certificate) -> str:
    return set_aside(certificate.examined.poses.rejected.counts()) or "none"


def _poses_aside(certificate: Certificate) -> str:
    believed = certificate.examined.believed
    count = int(np.count_nonzero(~believed))
    return f"{count} of {len(believed)}" if count else "none"


def _unit(about: About, unit: str, *keys: str) -> str:
    text = about.text(*keys)
    return text if text == NOT_STATED else f"{text} {unit}"


def dimensions_section(certificate: Certificate) -> Section:
    """Section on the dimensions identified by the session, and on those that are not."""
    found = [d for d in certificate.dimensions if d.identified]
    rest = [d for d in certificate.dimensions if not d.identified]
    tables = (
        Table(
            "dimensions_identified",
            f"Identified ({len(found)})",
            ("dimension", "nominal", "identified", "deviation", "U (k = 2)", "unit"),
            tuple(_dimension(d) for d in found),
            "U: twice the standard error from the data and the tolerances of the parts.",
            words=(0, 5),
        ),
        Table(
            "dimensions_open",
            f"Not identified by this session ({len(rest)})",
            ("dimension", "nominal", "tolerance of the part (1 σ)", "remaining [%]", "unit"),
            tuple(_open(d) for d in rest),
            "The data do not reduce the uncertainty of these dimensions below half of their "
            "tolerance, because other dimensions have the same effect. Their values are not "
            "certified. Positions do not suffer: either they do not depend on these dimensions, "
            "or the dependence is included in the uncertainty of positions.",
            words=(0, 4),
        ),
    )
    return Section(
        "dimensions",
        "Dimensions",
        _origin_of_dimensions(certificate),
        tuple(t for t in tables if t.rows),
    )


def _origin_of_dimensions(certificate: Certificate) -> tuple[str, ...]:
    """Sentence on dimensions that this session did not determine."""
    examined = certificate.examined
    if examined.fit is not None or examined.seen:
        return ()
    said = (
        f"Values and U are those of calibration {certificate.provenance.calibration}; this "
        "session does not determine them anew."
    )
    return (said + " Its points refute that calibration." if examined.doubts else said,)


def _dimension(d: Dimension) -> tuple[str, ...]:
    factor, unit = _UNITS.get(d.unit, (1.0, d.unit))
    u = factor * d.expanded
    return (
        spoken(d.name),
        rounded(factor * d.nominal, u),
        rounded(factor * d.value, u),
        rounded(factor * (d.value - d.nominal), u, sign=True),
        rounded(u, u),
        unit,
    )


def _open(d: Dimension) -> tuple[str, ...]:
    factor, unit = _UNITS.get(d.unit, (1.0, d.unit))
    left = 100 * d.expanded / (COVERAGE * d.tolerance)
    said = f"{left:.0f}" if left < _ALL else f"≥ {_ALL:.0f}"
    own = factor * d.tolerance
    return (spoken(d.name), rounded(factor * d.nominal, own), figures(own, 2), said, unit)


def points_section(certificate: Certificate) -> Section:
    """Section on every measured point with its error vectors."""
    points, u = certificate.points, certificate.budget.of_points
    examined = certificate.examined
    head = (
        "no.",
        "x",
        "y",
        "z",
        "before dx",
        "dy",
        "dz",
        "3-D",
        "after dx",
        "dy",
        "dz",
        "3-D",
        "U",
    )
    said = () if points is None else ("decision",)
    rows = tuple(
        (
            str(k + 1),
            *(
                f"{round(MM * float(v), 1) + 0.0:.1f}".replace("-", "−")
                for v in examined.target[k]
            ),
            *_error(examined.before[k], u[k]),
            *_error(examined.after[k], u[k]),
            figures(MM * float(u[k]), 2),
            *(() if points is None else (_said(points[k], bool(examined.believed[k])),)),
        )
        for k in range(len(examined.poses))
    )
    table = Table(
        "points",
        "Points [mm]",
        (*head, *said),
        rows,
        "Commanded position in the base frame. Before: measured minus commanded. After: the "
        "error that remains with corrected commands. U: expanded uncertainty (95 %) of the "
        "measured 3-D error.",
        words=() if points is None else (13,),
    )
    return Section(
        "points",
        "Errors of position",
        (),
        (table,),
        (histogram_figure(certificate), vector_figure(certificate)),
    )


def _error(error: Array, u: float) -> tuple[str, ...]:
    values = [*error, float(np.linalg.norm(error))]
    signs = (True, True, True, False)
    return tuple(
        rounded(MM * float(v), MM * float(u), sign) for v, sign in zip(values, signs, strict=True)
    )


def _said(decision: Decision, believed: bool) -> str:
    return decision.value if believed else "set aside"


def budget_section(certificate: Certificate) -> Section:
    """Section on the contributions to the uncertainty of positions."""
    budget = certificate.budget
    rows = [
        (part.name, part.kind, part.origin, *_axes(part.measured), *_axes(part.corrected))
        for part in budget.parts
    ]
    for name, factor in (("combined standard uncertainty", 1.0), ("U (k = 2)", COVERAGE)):
        both = [_axes(factor**2 * c) for c in (budget.measured, budget.corrected)]
        rows.append((name, "", "", *both[0], *both[1]))
    three = [
        figures(UM * float(np.sqrt(np.nanmean(radius**2))), 2)
        for radius in (budget.of_points, budget.of_corrected)
    ]
    gaps = "; ".join(certificate.about.gaps)
    caption = (
        "Standard uncertainties along the axes of the base in µm, root mean square of all "
        "measured poses. Kind as in the GUM: A from the statistics of this session, B from "
        "other sources. The line for the frame assumes known dimensions, the line for the "
        "dimensions lets the frame follow them; the two are therefore independent and add up. "
        f"3-D, 95 %: {three[0]} µm measured, {three[1]} µm corrected"
    )
    if budget.widen > 1.0:
        caption += (
            f" ({budget.widen:.2f} times the normal radius, because held-out errors are larger)"
        )
    text = (f"Not in the budget, because it was not stated: {gaps}.",) if gaps else ()
    table = Table(
        "budget",
        "",
        (
            "contribution",
            "kind",
            "origin",
            "measured u x",
            "u y",
            "u z",
            "corrected u x",
            "u y",
            "u z",
        ),
        tuple(rows),
        caption + ".",
        words=(0, 1, 2),
    )
    return Section("budget", "Uncertainty budget", text, (table,))


def _axes(covariance: Array | None) -> tuple[str, ...]:
    if covariance is None:
        return (NO_VALUE,) * 3
    return tuple(figures(UM * float(u), 2) for u in standard(covariance))
