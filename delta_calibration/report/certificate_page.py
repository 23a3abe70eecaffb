"""A certificate as sections of sentences, tables and figures, for HTML and PDF alike."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.report.about import NOT_STATED, About
from delta_calibration.report.budget import standard
from delta_calibration.report.certificate import COVERAGE, IDENTIFIED, MM, Certificate, Dimension
from delta_calibration.report.certificate_figures import (
    certified_figure,
    histogram_figure,
    vector_figure,
)
from delta_calibration.report.decision import Decision
from delta_calibration.report.document import KeyFigure, Report, Section, Statement, Table
from delta_calibration.report.parts import correlation_table, indices_table, unset_table
from delta_calibration.uncertainty import radius95
from delta_calibration.wording import NO_VALUE, capital, figures, moment, rounded, spoken

Array = NDArray[np.float64]

UM = 1e6
_UNITS = {"m": (1e3, "mm"), "rad": (1e3, "mrad"), "m/rad": (1e3, "mm/rad")}


def page_of_certificate(certificate: Certificate) -> Report:
    """All of it, in the order in which it is read."""
    examined, source = certificate.examined, certificate.provenance
    robot = examined.robot
    sections = (
        _conditions(certificate),
        _dimensions(certificate),
        _points(certificate),
        _certified(certificate),
        _budget(certificate),
        _appendix(certificate),
    )
    number = f" {certificate.number}" if certificate.number else ""
    return Report(
        title=f"Calibration certificate{number}: {robot.name}",
        subtitle=f"{source.session}, recorded {moment(source.start_ns)}; "
        f"{len(examined.poses)} poses at rest",
        sentence=_sentence(certificate),
        statements=_statements(certificate),
        key_figures=_key_figures(certificate),
        sections=tuple(section.renamed(robot.named) for section in sections),
        data={"certificate": certificate.as_dict()},
        signatures=("Calibrated by", "Approved by", "Place and date"),
    )


def _sentence(certificate: Certificate) -> str:
    left = _rms(certificate.error_after)
    tolerance, decision = certificate.about.tolerance, certificate.decision
    if tolerance is None or decision is None:
        return f"Corrected positions miss their targets by {left} mm RMS; no tolerance was given."
    allowed = f"a tolerance of {MM * tolerance:g} mm"
    points = certificate.points or ()
    passed, failed = (points.count(d) for d in (Decision.PASS, Decision.FAIL))
    said = {
        Decision.PASS: f"Passes {allowed} at all {len(points)} points.",
        Decision.FAIL: f"Fails {allowed} at {failed} of {len(points)} points.",
        Decision.NOT_DECIDED: f"Not decided for {allowed}: {passed} of {len(points)} points pass.",
    }
    return said[decision]


def _rms(error: Array) -> str:
    return figures(MM * float(np.sqrt(np.mean(error**2))), 2)


def _statements(certificate: Certificate) -> tuple[Statement, ...]:
    about, examined = certificate.about, certificate.examined
    instrument = _joined(
        about,
        ("instrument", "model"),
        ("serial", ("instrument", "serial")),
        ("certificate", ("instrument", "certificate")),
        ("valid until", ("instrument", "valid_until")),
    )
    machine = _joined(
        about, ("machine", "maker"), ("", ("machine", "model")), ("serial", ("machine", "serial"))
    )
    how = (
        "The calibration was made from this very session: the errors are not independent of it, "
        "and nothing passes by them."
        if examined.seen
        else "Every point is judged by a fit that has not seen it."
        if examined.fit is not None
        else f"Calibration {certificate.provenance.calibration}, made before; the tracker's frame "
        "is fitted to this session."
    )
    aside = int(np.count_nonzero(~examined.believed))
    more = f" {aside} points are gross errors by the fit and not judged." if aside else ""
    return (
        Statement("Machine", machine),
        Statement("Instrument", instrument),
        Statement("Operator", about.text("operator")),
        Statement("Tolerance", _tolerance(about)),
        Statement("Errors", how + more),
        *(Statement("Warning", capital(f"{text}.")) for text in examined.doubts),
    )


def _tolerance(about: About) -> str:
    if about.tolerance is None:
        return NOT_STATED
    return (
        f"{MM * about.tolerance:g} mm, 3-D. Decided by ISO 14253-1: a point passes where error + "
        "U is at most the tolerance, fails where error − U is above it; between the two nothing "
        "is decided."
    )


def _joined(about: About, first: tuple[str, ...], *rest: tuple[str, tuple[str, ...]]) -> str:
    parts = [about.text(*first)]
    parts += [f"{word} {about.text(*keys)}".strip() for word, keys in rest]
    stated = [part for part in parts if NOT_STATED not in part]
    missing = [word for word, keys in rest if word and about.text(*keys) == NOT_STATED]
    if not stated:
        return NOT_STATED
    return ", ".join(stated) + (f" ({', '.join(missing)} {NOT_STATED})" if missing else "")


def _key_figures(certificate: Certificate) -> tuple[KeyFigure, ...]:
    before, after = certificate.error_before, certificate.error_after
    largest = float(np.nanmax(certificate.certified))
    typical = float(np.nanmedian(certificate.certified))
    u = float(np.median(certificate.budget.of_points))
    decision = certificate.decision
    return (
        KeyFigure(
            "error before",
            rounded(MM * float(before.max()), MM * u),
            "mm",
            f"largest of {len(before)} points; RMS {_rms(before)} mm",
        ),
        KeyFigure(
            "error after",
            rounded(MM * float(after.max()), MM * u),
            "mm",
            f"largest; RMS {_rms(after)} mm; U of a point {figures(MM * u, 2)} mm",
        ),
        KeyFigure(
            "certified, 95 %",
            figures(MM * largest, 2),
            "mm",
            f"largest in the region, median {figures(MM * typical, 2)} mm: so near a corrected "
            "position comes",
        ),
        KeyFigure(
            "decision",
            NO_VALUE if decision is None else decision.value,
            "",
            "no tolerance given" if decision is None else "by ISO 14253-1, U counted",
        ),
    )


def _conditions(certificate: Certificate) -> Section:
    about = certificate.about
    poses = certificate.examined.poses
    warm = [
        f"{part} {poses.temperature[:, k].min():.1f} to {poses.temperature[:, k].max():.1f} °C"
        for k, part in enumerate(poses.temperature_parts)
        if np.isfinite(poses.temperature[:, k]).any()
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
    )
    return Section(
        "conditions", "Conditions", (), (Table("conditions", "", ("", ""), rows, words=(0, 1)),)
    )


def _aside(certificate: Certificate) -> str:
    counts = certificate.examined.poses.rejected.counts()
    return ", ".join(f"{n} {why}" for why, n in counts.items() if n) or "none"


def _unit(about: About, unit: str, *keys: str) -> str:
    text = about.text(*keys)
    return text if text == NOT_STATED else f"{text} {unit}"


def _dimensions(certificate: Certificate) -> Section:
    found = [d for d in certificate.dimensions if d.identified]
    rest = [d for d in certificate.dimensions if not d.identified]
    tables = (
        Table(
            "dimensions_identified",
            f"Identified ({len(found)})",
            ("dimension", "nominal", "identified", "deviation", "U (k = 2)", "unit"),
            tuple(_dimension(d) for d in found),
            "U: twice the standard error by the data and the tolerances of the parts.",
            words=(0, 5),
        ),
        Table(
            "dimensions_open",
            f"Not identified by this session ({len(rest)})",
            ("dimension", "nominal", "tolerance of the part (1 σ)", "left of it [%]", "unit"),
            tuple(_open(d) for d in rest),
            "The data leave more than half of the parts' tolerance open, alone or against each "
            "other. Nothing is certified of them; positions do not depend on them, or their share "
            "is in the uncertainty of positions.",
            words=(0, 4),
        ),
    )
    return Section("dimensions", "Dimensions", (), tuple(t for t in tables if t.rows))


def _dimension(d: Dimension) -> tuple[str, ...]:
    factor, unit = _UNITS.get(d.unit, (1.0, d.unit))
    u = factor * d.expanded
    return (
        spoken(d.name),
        rounded(factor * d.nominal, u),
        rounded(factor * d.value, u),
        rounded(factor * (d.value - d.nominal), u, sign=True),
        figures(u, 2),
        unit,
    )


def _open(d: Dimension) -> tuple[str, ...]:
    factor, unit = _UNITS.get(d.unit, (1.0, d.unit))
    left = 100 * d.expanded / (COVERAGE * d.tolerance)
    own = factor * d.tolerance
    return (spoken(d.name), rounded(factor * d.nominal, own), figures(own, 2), f"{left:.0f}", unit)


def _points(certificate: Certificate) -> Section:
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
            *(f"{MM * v:.1f}".replace("-", "−") for v in examined.target[k]),
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
        "Place by the drawing in the base; measured less commanded before, and what is left of it "
        "with corrected commands. U: expanded uncertainty (95 %) of the 3-D error as measured.",
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


def _certified(certificate: Certificate) -> Section:
    largest = MM * float(np.nanmax(certificate.certified))
    text = (
        f"With 95 % a corrected position comes within {figures(largest, 2)} mm of its target "
        "anywhere in the measured region, at payloads and temperatures like those of the session. "
        "Counted are the fit, how the joints come to rest, what the model leaves at places that "
        "it has not seen, and what was stated of instrument and temperature.",
    )
    return Section("certified", "Certified positions", text, (), (certified_figure(certificate),))


def _budget(certificate: Certificate) -> Section:
    budget = certificate.budget
    rows = [
        (part.name, part.kind, part.origin, *_axes(part.measured), *_axes(part.corrected))
        for part in budget.parts
    ]
    for name, factor in (("combined standard uncertainty", 1.0), ("U (k = 2)", COVERAGE)):
        both = [_axes(factor**2 * c) for c in (budget.measured, budget.corrected)]
        rows.append((name, "", "", *both[0], *both[1]))
    three = [
        figures(UM * scale * float(np.sqrt(np.mean(radius95(c) ** 2))), 2)
        for scale, c in ((1.0, budget.measured), (budget.widen, budget.corrected))
    ]
    silent = certificate.about.silent
    caption = (
        "Root mean square of all measured poses, about the axes of the base, in µm. Kind by GUM: "
        "A from this session's statistics, B as stated elsewhere. Frame: with the dimensions "
        "known; dimensions: with the frame following them; so they are independent and add up. "
        f"3-D, 95 %: {three[0]} µm measured, {three[1]} µm corrected"
    )
    if budget.widen > 1.0:
        caption += f" ({budget.widen:.2f} times the normal one: errors held out reach farther)"
    text = (
        (f"Not in the budget, as nothing was stated of it: {', '.join(silent)}.",)
        if silent
        else ()
    )
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


def _appendix(certificate: Certificate) -> Section:
    found = certificate.examined.fit
    tables = [certificate.provenance.table()]
    text: tuple[str, ...] = ()
    if found is not None:
        text = (
            f"Chi square per degree of freedom {found.chi_square:.2f}; noise of a pose "
            f"{figures(UM * found.noise.floor, 2)} µm RMS in 3-D; poses held out are missed by "
            f"{found.full.held_out_whitened:.2f} times the noise. A dimension counts as "
            f"identified where the data leave less than {100 * IDENTIFIED:.0f} % of its "
            "tolerance.",
        )
        tables = [indices_table(found), correlation_table(found), unset_table(found), *tables]
    return Section("appendix", "Appendix: statistics and provenance", text, tuple(tables))
