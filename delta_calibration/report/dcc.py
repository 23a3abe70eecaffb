"""Export of a certificate as a Digital Calibration Certificate (DCC): PTB's XML 3.3.0, D-SI 2.

The page is for people to read and sign; the DCC has the same content for programs. Numbers are in
SI units in the notation of D-SI. A DCC must state who calibrated what for whom: without these
statements it is refused; other missing statements are left out.

Source: PTB, XML Schema Definition of the DCC, version 3.3.0 (https://ptb.de/dcc/v3.3.0/), and of
D-SI, version 2.2.1 (https://ptb.de/si/v2.2.1/).
"""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime, timezone
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent, register_namespace

import numpy as np
from numpy.typing import NDArray

from delta_calibration import __version__
from delta_calibration.errors import InputError
from delta_calibration.files import written_whole
from delta_calibration.report.about import NOT_STATED, About
from delta_calibration.report.certificate import COVERAGE, RULE, Certificate
from delta_calibration.report.decision import Decision
from delta_calibration.wording import dated

Array = NDArray[np.float64]

VERSION = "3.3.0"
DCC, SI = "https://ptb.de/dcc", "https://ptb.de/si"
_XSI = "http://www.w3.org/2001/XMLSchema-instance"
_LANGUAGE = "en"
_UNITS = {
    "m": r"\metre",
    "rad": r"\radian",
    "degC": r"\degreecelsius",
    "%": r"\percent",
    "hPa": r"\hecto\pascal",
    "1": r"\one",
    "m/rad": r"\metre\radian\tothe{-1}",
}
_MUST = (  # entries of `about`, in words
    (("number",), "number"),
    (("customer",), "customer"),
    (("operator",), "operator"),
    (("machine", "serial"), "machine: {serial: ...}"),
    (("laboratory", "name"), "laboratory: {name: ...}"),
    (("laboratory", "country"), "laboratory: {country: ...}"),
)
_LOCATION = {"city": "city", "country": "countryCode", "street": "street", "post_code": "postCode"}
_CONFORMITY = {Decision.PASS: "pass", Decision.FAIL: "fail"}


def write_dcc(path: Path, certificate: Certificate) -> None:
    """Write a DCC atomically.

    Raises:
        InputError: the certificate lacks a mandatory entry, or the file cannot be written.
    """
    root = dcc_of(certificate)
    indent(root)
    with written_whole(path) as beside:
        ElementTree(root).write(beside, encoding="utf-8", xml_declaration=True)


def dcc_of(certificate: Certificate) -> Element:
    """Build the root element of a DCC.

    Raises:
        InputError: the certificate lacks an entry that is mandatory in a DCC.
    """
    require_stated(certificate.about, certificate.examined.poses.start_ns)
    register_namespace("dcc", DCC)
    register_namespace("si", SI)
    root = Element(
        f"{{{DCC}}}digitalCalibrationCertificate",
        {
            "schemaVersion": VERSION,
            f"{{{_XSI}}}schemaLocation": f"{DCC} {DCC}/v{VERSION}/dcc.xsd",
        },
    )
    _administrative(root, certificate)
    results = _in(root, "measurementResults")
    _result(_in(results, "measurementResult"), certificate)
    return root


def require_stated(about: About, start_ns: int | None = None) -> None:
    """Refuse statements that lack a mandatory entry of a DCC.

    Args:
        about: the statements.
        start_ns: begin of the session, Unix time [ns]; None if it is not known yet.

    Raises:
        InputError: an entry is missing; the message names all that are.
    """
    missing = [words for keys, words in _MUST if about.text(*keys) == NOT_STATED]
    undated = start_ns is not None and not dated(start_ns)
    if undated and about.text("measured_on") == NOT_STATED:
        missing.append("measured_on (the session has no date)")
    if missing:
        raise InputError(
            "a Digital Calibration Certificate must say who calibrated what for whom; missing in "
            f"--about: {', '.join(missing)}"
        )


def _in(parent: Element, name: str, text: str | None = None, space: str = DCC) -> Element:
    child = SubElement(parent, f"{{{space}}}{name}")
    child.text = text
    return child


def _si(parent: Element, name: str, text: str | None = None) -> Element:
    return _in(parent, name, text, SI)


def _words(parent: Element, name: str, text: str) -> Element:
    """Add an element with a text in one language."""
    child = _in(parent, name)
    _in(child, "content", text).set("lang", _LANGUAGE)
    return child


# Who, what, for whom


def _administrative(root: Element, certificate: Certificate) -> None:
    about, data = certificate.about, _in(root, "administrativeData")
    _software(_in(data, "dccSoftware"))
    _core(_in(data, "coreData"), certificate)
    _item(_in(_in(data, "items"), "item"), about)
    laboratory = _in(data, "calibrationLaboratory")
    _contact(laboratory, "contact", about.text("laboratory", "name"), about, "laboratory")
    person = _in(_in(data, "respPersons"), "respPerson")
    _words(_in(person, "person"), "name", about.text("operator"))
    _in(person, "mainSigner", "true")
    _contact(data, "customer", about.text("customer"), about, "customer_address")
    if (decision := certificate.decision) is not None:
        _statement(_in(_in(data, "statements"), "statement"), certificate, decision)


def _software(parent: Element) -> None:
    own = _in(parent, "software")
    _words(own, "name", "delta_calibration")
    _in(own, "release", __version__)
    _in(own, "type", "application")


def _core(core: Element, certificate: Certificate) -> None:
    about, poses = certificate.about, certificate.examined.poses
    _in(core, "countryCodeISO3166_1", about.text("laboratory", "country"))
    _in(core, "usedLangCodeISO639_1", _LANGUAGE)
    _in(core, "mandatoryLangCodeISO639_1", _LANGUAGE)
    _in(core, "uniqueIdentifier", about.text("number"))
    _identifications(
        core,
        (
            ("other", certificate.provenance.session_sha256, "SHA-256 of the session"),
            ("other", certificate.examined.robot.hash, "SHA-256 of the robot file"),
        ),
    )
    begin, end = (_day(poses.start_ns * 1e-9 + after) for after in (0.0, poses.duration))
    stated = about.text("measured_on")
    _in(core, "beginPerformanceDate", begin if stated == NOT_STATED else stated)
    _in(core, "endPerformanceDate", end if stated == NOT_STATED else stated)
    place = about.text("laboratory", "performed_at")
    _in(core, "performanceLocation", "other" if place == NOT_STATED else place)


def _day(seconds: float) -> str:
    """Date (UTC) of a Unix time [s]."""
    return datetime.fromtimestamp(seconds, timezone.utc).date().isoformat()


def _item(item: Element, about: About) -> None:
    model, maker = about.text("machine", "model"), about.text("machine", "maker")
    _words(item, "name", "robot" if model == NOT_STATED else model)
    if maker != NOT_STATED:
        _words(_in(item, "manufacturer"), "name", maker)
    if model != NOT_STATED:
        _in(item, "model", model)
    _identifications(item, (("manufacturer", about.text("machine", "serial"), "serial number"),))


def _identifications(parent: Element, rows: Iterable[tuple[str, str, str]]) -> None:
    """Add identification numbers, each with issuer, value and name."""
    given = [row for row in rows if row[1] not in ("", NOT_STATED)]
    if not given:
        return
    whole = _in(parent, "identifications")
    for issuer, value, name in given:
        one = _in(whole, "identification")
        _in(one, "issuer", issuer)
        _in(one, "value", value)
        _words(one, "name", name)


def _contact(parent: Element, kind: str, name: str, about: About, where: str) -> None:
    contact = _in(parent, kind)
    _words(contact, "name", name)
    location = _in(contact, "location")
    for key, element in _LOCATION.items():
        if (text := about.text(where, key)) != NOT_STATED:
            _in(location, element, text)
    if not len(location):
        _words(location, "further", NOT_STATED)


def _statement(statement: Element, certificate: Certificate, decision: Decision) -> None:
    _words(statement, "name", "tolerance of the 3-D error")
    _in(statement, "norm", "ISO 14253-1")
    said = f"tolerance {1e3 * (certificate.about.tolerance or 0.0):g} mm: {decision.value}. {RULE}"
    _words(statement, "declaration", said + _lacking(certificate.about))
    if decision in _CONFORMITY:
        _in(statement, "conformity", _CONFORMITY[decision])


def _lacking(about: About) -> str:
    """Remark on contributions that are missing in every uncertainty; empty if there are none."""
    gaps = "; ".join(about.gaps)
    return f". Missing in the uncertainties, because not stated: {gaps}" if gaps else ""


# What was measured


def _result(whole: Element, certificate: Certificate) -> None:
    about = certificate.about
    _words(whole, "name", "kinematic calibration")
    method = _in(_in(whole, "usedMethods"), "usedMethod")
    _words(method, "name", "dimensions by least squares of measured positions")
    _in(method, "norm", "JCGM 100:2008")
    _software(_in(whole, "usedSoftware"))
    _instrument(_in(_in(whole, "measuringEquipments"), "measuringEquipment"), about)
    _conditions(whole, about)
    results = _in(whole, "results")
    _dimensions(_in(results, "result"), certificate)
    _points(_in(results, "result"), certificate)
    _certified(_in(results, "result"), certificate)


def _instrument(equipment: Element, about: About) -> None:
    model = about.text("instrument", "model")
    _words(equipment, "name", "laser tracker" if model == NOT_STATED else model)
    if model != NOT_STATED:
        _in(equipment, "model", model)
    _identifications(
        equipment,
        (
            ("manufacturer", about.text("instrument", "serial"), "serial number"),
            ("other", about.text("instrument", "certificate"), "calibration certificate"),
        ),
    )


def _conditions(whole: Element, about: About) -> None:
    rows = (
        ("ambient temperature", "temperature_c", "degC", "u_temperature_k"),
        ("relative humidity", "humidity_percent", "%", None),
        ("air pressure", "pressure_hpa", "hPa", None),
    )
    given = [(row, about.number("ambient", row[1])) for row in rows]
    if all(value is None for _, value in given):
        return
    conditions = _in(whole, "influenceConditions")
    for (name, _, unit, unsure), value in given:
        if value is not None:
            condition = _in(conditions, "influenceCondition")
            _words(condition, "name", name)
            std = None if unsure is None else about.number("ambient", unsure)
            expanded = None if std is None else COVERAGE * std
            _quantity(_in(condition, "data"), name, value, unit, expanded)


def _dimensions(result: Element, certificate: Certificate) -> None:
    _words(result, "name", "dimensions that were identified")
    rows = _in(_in(result, "data"), "list")
    found = [dimension for dimension in certificate.dimensions if dimension.identified]
    for dimension in found:
        _quantity(rows, dimension.name, dimension.value, dimension.unit, dimension.expanded)
    if not found:
        _none(rows, "this session identifies none")


def _points(result: Element, certificate: Certificate) -> None:
    _words(result, "name", "measured points")
    rows = _in(_in(result, "data"), "list")
    for name, column in zip(("x", "y", "z"), certificate.examined.target.T, strict=True):
        _column(rows, f"commanded {name}", column)
    _column(rows, "3-D error before", certificate.error_before)
    _column(rows, "3-D error after", certificate.error_after)
    _column(rows, "expanded uncertainty (95 %) of the 3-D error", certificate.budget.of_points)


def _certified(result: Element, certificate: Certificate) -> None:
    name = "95 % radius of corrected positions in the region"
    _words(result, "name", name + _lacking(certificate.about))
    rows, radius = _in(_in(result, "data"), "list"), certificate.certified
    _quantity(rows, "largest", float(np.nanmax(radius)), "m")
    _quantity(rows, "median", float(np.nanmedian(radius)), "m")


def _none(parent: Element, why: str) -> None:
    quantity = _in(parent, "quantity")
    _words(quantity, "noQuantity", why)


def _quantity(
    parent: Element, name: str, value: float, unit: str, expanded: float | None = None
) -> None:
    """Add a number, with its expanded uncertainty U (k = 2) if given."""
    quantity = _in(parent, "quantity")
    _words(quantity, "name", name)
    real = _si(quantity, "real")
    _si(real, "value", _number(value))
    _si(real, "unit", _UNITS[unit])
    if expanded is not None:
        one = _si(_si(real, "measurementUncertaintyUnivariate"), "expandedMU")
        _si(one, "valueExpandedMU", _number(expanded))
        _si(one, "coverageFactor", _number(COVERAGE))
        _si(one, "coverageProbability", "0.95")
        _si(one, "distribution", "normal")


def _column(parent: Element, name: str, values: Array) -> None:
    """Add a list of lengths [m], one for each point."""
    quantity = _in(parent, "quantity")
    _words(quantity, "name", name)
    rows = _si(quantity, "realListXMLList")
    _si(rows, "valueXMLList", " ".join(map(_number, values)))
    _si(rows, "unitXMLList", _UNITS["m"])


def _number(value: float) -> str:
    return f"{float(value):.9g}"
