"""Tests of the Digital Calibration Certificate: structure by PTB's schema 3.3.0, refusals, values.

The schema itself is PTB's and is not in this repository. Its requirements for the elements that
are written (order, required ones, permitted values) are stated here from its text.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

pytest.importorskip("jinja2", reason="needs the extra [report]")
pytest.importorskip("xmlschema", reason="needs the extra [report]")

from delta_calibration.cli import certificate as commands
from delta_calibration.cli.main import run
from delta_calibration.errors import InputError
from delta_calibration.report.about import read_about
from delta_calibration.report.dcc import require_stated

DCC, SI = "{https://ptb.de/dcc}", "{https://ptb.de/si}"
ABOUT = """\
number: K-14
tolerance_mm: 0.06
operator: A & B
customer: packaging line 3
laboratory: {name: bench 2, country: DE, city: Musterstadt}
machine: {model: SRBD, maker: maker, serial: "0017", expansion_um_per_m_k: 11.5}
instrument: {model: tracker, serial: LT-1, certificate: C-1, u_along_um: 1, u_across_um: 3}
ambient: {temperature_c: 21.4, u_temperature_k: 0.5, humidity_percent: 40}
"""

# element: its children in order; ! required, * may be repeated
MODEL = {
    "digitalCalibrationCertificate": "administrativeData! measurementResults!",
    "administrativeData": "dccSoftware! coreData! items! calibrationLaboratory! respPersons! "
    "customer! statements",
    "dccSoftware": "software!*",
    "usedSoftware": "software!*",
    "software": "name! release! type",
    "coreData": "countryCodeISO3166_1! usedLangCodeISO639_1!* mandatoryLangCodeISO639_1!* "
    "uniqueIdentifier! identifications beginPerformanceDate! endPerformanceDate! "
    "performanceLocation!",
    "identifications": "identification!*",
    "identification": "issuer! value! name",
    "items": "item!*",
    "item": "name! manufacturer model identifications!",
    "manufacturer": "name!",
    "calibrationLaboratory": "contact!",
    "contact": "name! location!",
    "customer": "name! location!",
    "respPersons": "respPerson!*",
    "respPerson": "person! mainSigner",
    "person": "name!",
    "statements": "statement!*",
    "statement": "name norm declaration conformity",
    "measurementResults": "measurementResult!*",
    "measurementResult": "name! usedMethods usedSoftware measuringEquipments influenceConditions "
    "results!",
    "usedMethods": "usedMethod!*",
    "usedMethod": "name! norm",
    "measuringEquipments": "measuringEquipment!*",
    "measuringEquipment": "name! model identifications",
    "influenceConditions": "influenceCondition!*",
    "influenceCondition": "name! data!",
    "results": "result!*",
    "result": "name! data!",
    "data": "quantity* list*",
    "list": "quantity!*",
    "quantity": "name noQuantity real realListXMLList",
    "real": "value! unit! measurementUncertaintyUnivariate",
    "measurementUncertaintyUnivariate": "expandedMU!",
    "expandedMU": "valueExpandedMU! coverageFactor! coverageProbability! distribution",
    "realListXMLList": "valueXMLList! unitXMLList!",
    **dict.fromkeys(("name", "declaration", "further", "noQuantity"), "content!*"),
}
ANY_ORDER = {"location": {"city", "countryCode", "postCode", "street", "further"}}
VALUES = {
    "issuer": "manufacturer|calibrationLaboratory|customer|owner|other",
    "performanceLocation": "laboratory|customer|laboratoryBranch|customerBranch|other",
    "conformity": "pass|fail|conditionalPass|conditionalFail|noPass|noFail",
    "countryCodeISO3166_1": "[A-Z]{2}",
    "usedLangCodeISO639_1": "[a-z]{2}",
    "beginPerformanceDate": r"\d{4}-\d\d-\d\d",
    "endPerformanceDate": r"\d{4}-\d\d-\d\d",
    "uniqueIdentifier": r"\S+(\s+\S+)*",
    "value": r"\S+(\s+\S+)*",
    "unit": r"(\\[a-z]+(\\tothe\{-?\d+\})?)+",
    "mainSigner": "true|false",
    "type": "application|bios|driver|editor|firmware|library|os|other",
}


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session, the statements on it, and its certificate."""
    folder = tmp_path_factory.mktemp("dcc")
    made = ["--robot", "srbd", "--plan", "identify", "--seed", "3", "--count", "30"]
    assert run(["simulate", *made, "--out", str(folder / "session")]) == 0
    (folder / "about.yaml").write_text(ABOUT, encoding="utf-8")
    assert certificate(folder, "about.yaml") == 0
    return folder


def certificate(folder: Path, about: str, *options: str) -> int:
    given = ["--about", str(folder / about), "--out", str(folder / "certificate.xml")]
    return run(["certificate", str(folder / "session"), "--robot", "srbd", *given, *options])


def local(element: ElementTree.Element) -> str:
    return element.tag.partition("}")[2]


def require_model(element: ElementTree.Element) -> None:
    name, children = local(element), [local(child) for child in element]
    if name in ANY_ORDER:
        assert children
        assert set(children) <= ANY_ORDER[name]
    elif name in MODEL:
        asked = MODEL[name].split()
        pattern = "".join(
            f"(?:{one.rstrip('!*')} )" + {"!": "", "!*": "+", "*": "*", "": "?"}[mark]
            for one in asked
            for mark in [one[len(one.rstrip("!*")) :]]
        )
        assert re.fullmatch(pattern, "".join(f"{child} " for child in children)), (name, children)
    else:
        assert not children, name
        assert element.text
        assert element.text.strip()
    if name in VALUES:
        assert re.fullmatch(VALUES[name], element.text or ""), (name, element.text)
    for child in element:
        require_model(child)


def test_none_is_written_beside_a_refused_pdf(
    cell: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The font of the PDF lacks a letter of the operator's name."""
    given = [str(cell / "session"), "--robot", "srbd", "--about", str(cell / "about.yaml")]
    outs = [word for end in ("xml", "pdf") for word in ("--out", str(tmp_path / f"c.{end}"))]
    assert run(["certificate", *given, *outs, "--operator", "\u5f20"]) == 2
    assert "no letters \u5f20" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_it_is_built_as_the_schema_says(cell: Path) -> None:
    root = ElementTree.parse(cell / "certificate.xml").getroot()
    assert root.tag == f"{DCC}digitalCalibrationCertificate"
    assert root.get("schemaVersion") == "3.3.0"
    require_model(root)
    spaces = {local(e): e.tag.partition("}")[0] + "}" for e in root.iter()}
    assert {spaces[name] for name in ("real", "unit", "realListXMLList", "expandedMU")} == {SI}


def test_its_numbers_are_those_of_the_json(cell: Path) -> None:
    root = ElementTree.parse(cell / "certificate.xml").getroot()
    told = json.loads((cell / "certificate.json").read_text(encoding="utf-8"))
    numbers = {
        quantity.findtext(f"{DCC}name/{DCC}content"): quantity
        for quantity in root.iter(f"{DCC}quantity")
    }
    found = [each for each in told["dimensions"] if each["identified"] is not None]
    assert len(found) > 5
    for each in found:
        real = numbers[each["name"]].find(f"{SI}real")
        assert real is not None
        assert float(real.findtext(f"{SI}value") or "") == pytest.approx(each["identified"])
        inside = f"{SI}measurementUncertaintyUnivariate/{SI}expandedMU/"
        assert float(real.findtext(f"{inside}{SI}valueExpandedMU") or "") == pytest.approx(
            each["U"]
        )
        assert real.findtext(f"{inside}{SI}coverageFactor") == "2"
        assert real.findtext(f"{SI}unit") == {"m": r"\metre", "rad": r"\radian"}[each["unit"]]
    after = numbers["3-D error after"].findtext(f"{SI}realListXMLList/{SI}valueXMLList") or ""
    assert [1e3 * float(v) for v in after.split()] == pytest.approx(
        [
            point["after_mm"]
            if isinstance(point["after_mm"], float)
            else sum(v * v for v in point["after_mm"]) ** 0.5
            for point in told["points"]
        ]
    )
    warm = numbers["ambient temperature"]
    assert warm.findtext(f"{SI}real/{SI}value") == "21.4"


def test_what_a_dcc_must_say_is_asked_for(cell: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Everything that is missing is listed at once; nothing is written."""
    (cell / "bare.yaml").write_text("number: K-15\n", encoding="utf-8")
    files = [cell / f"certificate.{kind}" for kind in ("xml", "json")]
    before = [file.read_bytes() for file in files]
    assert certificate(cell, "bare.yaml") != 0
    said = capsys.readouterr().err
    for entry in ("customer", "operator", "machine: {serial", "laboratory: {name", "country"):
        assert entry in said
    assert "number," not in said
    assert [file.read_bytes() for file in files] == before


def test_what_a_dcc_must_say_is_asked_for_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr(commands, "read_session", refuse)
    outs = [word for end in ("html", "xml") for word in ("--out", str(tmp_path / f"c.{end}"))]
    assert run(["certificate", str(tmp_path), "--robot", "srbd", *outs]) == 2
    assert "missing in --about: number, customer" in capsys.readouterr().err


def test_a_dcc_names_what_its_uncertainties_lack(cell: Path) -> None:
    """The reflector is not stated; the rest is."""
    assert certificate(cell, "about.yaml") == 0
    root = ElementTree.parse(cell / "certificate.xml").getroot()
    said = [element.text or "" for element in root.iter(f"{DCC}content")]
    lacking = "Missing in the uncertainties, because not stated: reflector"
    assert sum(lacking in text for text in said) == 2


def test_a_stated_day_stands_in_the_certificate(cell: Path) -> None:
    """A date as usual in YAML, without quotes; without it a table without dates is of 1970."""
    (cell / "day.yaml").write_text(f"{ABOUT}measured_on: 2026-11-24\n", encoding="utf-8")
    assert certificate(cell, "day.yaml") in (0, 1)
    root = ElementTree.parse(cell / "certificate.xml").getroot()
    days = [root.findtext(f".//{DCC}{end}PerformanceDate") for end in ("begin", "end")]
    assert days == ["2026-11-24", "2026-11-24"]
    assert certificate(cell, "about.yaml") == 0
    with pytest.raises(InputError, match=r"measured_on \(the session has no date\)"):
        require_stated(read_about(cell / "about.yaml", {}), 0)


def test_a_country_is_two_letters(cell: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (cell / "bad.yaml").write_text(ABOUT.replace("country: DE", "country: Germany"), "utf-8")
    assert certificate(cell, "bad.yaml") != 0
    assert "laboratory.country" in capsys.readouterr().err


# A minimal schema with PTB's namespaces: one element, and one that it imports.
OUTER = """\
<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" targetNamespace="https://ptb.de/dcc"
    xmlns:si="https://ptb.de/si" elementFormDefault="qualified">
  <xs:import namespace="https://ptb.de/si" schemaLocation="https://ptb.de/si/v2.2.1/SI.xsd"/>
  <xs:element name="digitalCalibrationCertificate"><xs:complexType>
    <xs:sequence>
      <xs:any namespace="##any" processContents="skip" minOccurs="FEWEST" maxOccurs="9"/>
    </xs:sequence>
    <xs:attribute name="schemaVersion" use="required"/>
    <xs:anyAttribute processContents="skip"/>
  </xs:complexType></xs:element>
</xs:schema>
"""
INNER = """\
<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" targetNamespace="https://ptb.de/si">
  <xs:element name="real" type="xs:double"/>
</xs:schema>
"""


def test_it_is_checked_by_a_schema_that_is_given(
    cell: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Imports are found in the folder by their namespace, not downloaded."""
    folder = cell / "schema"
    (folder / "si").mkdir(parents=True)
    (folder / "si" / "units.xsd").write_text(INNER, encoding="utf-8")
    option = ("--dcc-schema", str(folder))
    assert certificate(cell, "about.yaml", *option) != 0
    assert "contains no schema of https://ptb.de/dcc" in capsys.readouterr().err
    (folder / "dcc.xsd").write_text(OUTER.replace("FEWEST", "2"), encoding="utf-8")
    assert certificate(cell, "about.yaml", *option) == 0
    assert "valid according to the schema" in capsys.readouterr().out
    (folder / "dcc.xsd").write_text(OUTER.replace("FEWEST", "3"), encoding="utf-8")
    assert certificate(cell, "about.yaml", *option) != 0
    assert "does not conform to" in capsys.readouterr().err
    (folder / "dcc.xsd").write_text("<xs:schema", encoding="utf-8")
    assert certificate(cell, "about.yaml", *option) != 0
    assert "not XML" in capsys.readouterr().err


def test_it_says_that_it_was_not_checked(cell: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert certificate(cell, "about.yaml") == 0
    assert "not validated" in capsys.readouterr().out
