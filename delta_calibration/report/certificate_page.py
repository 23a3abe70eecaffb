"""Report of a certificate: sections of sentences, tables and figures, for HTML and PDF."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.report.about import NOT_STATED, STATED, About
from delta_calibration.report.certificate import IDENTIFIED, MM, Certificate
from delta_calibration.report.certificate_figures import certified_figure
from delta_calibration.report.certificate_sections import (
    budget_section,
    conditions_section,
    dimensions_section,
    points_section,
)
from delta_calibration.report.decision import Decision
from delta_calibration.report.document import KeyFigure, Report, Section, Statement
from delta_calibration.report.parts import correlation_table, indices_table, unset_table
from delta_calibration.wording import NO_VALUE, capital, day, figures, moment, rounded

Array = NDArray[np.float64]

UM = 1e6


def page_of_certificate(certificate: Certificate) -> Report:
    """Make the report of a certificate."""
    examined, source = certificate.examined, certificate.provenance
    robot = examined.robot
    sections = (
        conditions_section(certificate),
        dimensions_section(certificate),
        points_section(certificate),
        _certified(certificate),
        budget_section(certificate),
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
    """The decision in words, with a remark if contributions to U were not stated."""
    missing = len(certificate.about.gaps)
    lacks = f" U is incomplete: {missing} of {len(STATED)} contributions are {NOT_STATED}."
    return _decided(certificate) + (lacks if missing else "")


def _decided(certificate: Certificate) -> str:
    left = _rms(certificate.error_after)
    tolerance, decision = certificate.about.tolerance, certificate.decision
    if tolerance is None or decision is None:
        return f"Corrected positions are {left} mm RMS from their targets; no tolerance was given."
    allowed = f"a tolerance of {MM * tolerance:g} mm"
    points = certificate.points or ()
    passed, failed = (points.count(d) for d in (Decision.PASS, Decision.FAIL))
    if certificate.examined.seen and decision is not Decision.FAIL:
        return f"Not decided for {allowed}: the calibration was made from this very session."
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
        "so no point can pass."
        if examined.seen
        else "Every point is judged by a fit that does not contain it."
        if examined.fit is not None
        else f"Calibration {certificate.provenance.calibration} was made before; only the "
        f"tracker's frame is fitted to this session. {_origin(examined.stated)}"
    )
    gaps = "; ".join(about.gaps)
    lacking = (
        f"U, the certified radius and the decision lack these contributions, because they were "
        f"{NOT_STATED}: {gaps}. The true uncertainty is larger."
    )
    expired = about.expired(day(certificate.provenance.start_ns))
    warned = (*examined.doubts, *([expired] if expired else ()))
    aside = int(np.count_nonzero(~examined.believed))
    more = f" {_set_aside(aside, len(examined.poses))}" if aside else ""
    return (
        *((Statement("Incomplete uncertainty", lacking),) if gaps else ()),
        Statement("Number", about.text("number")),
        Statement("Machine", machine),
        Statement("Instrument", instrument),
        Statement("Operator", about.text("operator")),
        Statement("Dates", _dates(certificate)),
        Statement("Tolerance", _tolerance(about)),
        Statement("Errors", how + more),
        *(Statement("Warning", capital(f"{text}.")) for text in warned),
    )


def _origin(stated: bool) -> str:
    """Sentence on the uncertainty of corrected positions with an earlier calibration."""
    if stated:
        return "Its residuals agree with the uncertainty that the calibration states."
    return (
        "Its residuals are larger than the calibration states; model error, play and "
        "repeatability in the budget therefore follow from them."
    )


def _dates(certificate: Certificate) -> str:
    """Dates of the measurement and of the issue of the certificate."""
    source = certificate.provenance
    stated = certificate.about.text("measured_on")
    measured = moment(source.start_ns) if stated == NOT_STATED else stated
    issued = "" if source.made_ns is None else f"; issued {moment(source.made_ns)}"
    return f"measured {measured}{issued}"


def _set_aside(aside: int, poses: int) -> str:
    what = "is a gross error" if aside == 1 else "are gross errors"
    return f"{aside} of {poses} poses {what} according to the fit, and not judged."


def _tolerance(about: About) -> str:
    if about.tolerance is None:
        return NOT_STATED
    return (
        f"{MM * about.tolerance:g} mm, 3-D. Decision rule of ISO 14253-1: a point passes if "
        "error + U is at most the tolerance, fails if error − U is above it, and is undecided "
        "otherwise."
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
    decision, lacks = certificate.decision, bool(certificate.about.gaps)
    incomplete = ", as far as stated" if lacks else ""
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
            f"largest; RMS {_rms(after)} mm; U of a point {figures(MM * u, 2)} mm{incomplete}",
        ),
        KeyFigure(
            "certified, 95 %",
            figures(MM * largest, 2),
            "mm",
            "largest 95 % radius of a corrected position in the region; median "
            f"{figures(MM * typical, 2)} mm{'; uncertainty incomplete' if lacks else ''}",
        ),
        KeyFigure(
            "decision",
            NO_VALUE if decision is None else decision.value,
            "",
            "no tolerance given"
            if decision is None
            else f"by ISO 14253-1, including U{incomplete}",
        ),
    )


def _certified(certificate: Certificate) -> Section:
    largest = MM * float(np.nanmax(certificate.certified))
    about = certificate.about
    stated = "; ".join(name for name in STATED if name not in about.silent)
    text = (
        f"With a probability of 95 %, a corrected position is within {figures(largest, 2)} mm of "
        "its target anywhere in the measured region, at payloads and temperatures like those of "
        "the session. This includes the uncertainty of the fit, the repeatability of the "
        "joints, and the error of the model at places it has not seen.",
        *((f"It includes as stated: {stated}.",) if stated else ()),
        *(
            (f"It does not include, because not stated: {'; '.join(about.gaps)}.",)
            if about.gaps
            else ()
        ),
    )
    return Section("certified", "Certified positions", text, (), (certified_figure(certificate),))


def _appendix(certificate: Certificate) -> Section:
    found = certificate.examined.fit
    tables = [certificate.provenance.table()]
    text: tuple[str, ...] = ()
    if found is not None:
        text = (
            f"Chi square per degree of freedom {found.chi_square:.2f}; noise of a pose "
            f"{figures(UM * found.noise.floor, 2)} µm RMS in 3-D; error left "
            f"{found.full.held_out_whitened:.2f} times the noise. A dimension counts as "
            f"identified if the data reduce its uncertainty below {100 * IDENTIFIED:.0f} % of "
            "its tolerance.",
        )
        tables = [indices_table(found), correlation_table(found), unset_table(found), *tables]
    return Section("appendix", "Appendix: statistics and provenance", text, tuple(tables))
