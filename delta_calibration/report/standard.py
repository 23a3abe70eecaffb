"""Report section with the criteria of ISO 9283, cycles and conditions."""

from __future__ import annotations

from delta_calibration.accuracy import IsoReport
from delta_calibration.report.document import Section, Table
from delta_calibration.wording import mm

MM = 1e3
_MEANING = {
    "AP": "pose accuracy",
    "RP": "pose repeatability",
    "AD": "distance accuracy",
    "RD": "distance repeatability, ±",
    "AT": "path accuracy",
    "RT": "path repeatability",
}


def standard_section(iso: IsoReport | str) -> Section:
    """Section with the table of criteria, or with the reason why there is none."""
    title = "Accuracy by ISO 9283"
    if isinstance(iso, str):
        why = "This session does not contain the cycles of the standard"
        how = "Record them by the plan iso9283, and name that session with --iso9283"
        return Section("iso9283", title, (f"{why}: {iso}. {how}.",))
    c = iso.conditions
    text = (
        f"{c.name}: {c.position_cycles} cycles for positions, {c.distance_cycles} for distances, "
        f"{c.path_cycles} for paths at {c.stations} stations; {100 * c.speed_fraction:.0f} % of "
        f"the rated speed and {100 * c.load_fraction:.0f} % of the rated load are required by "
        f"the conditions and not checked. Tracker frame from the {iso.frame}.",
        *(f"Left out: {sentence}." for sentence in iso.left_out),
    )
    rows = tuple(
        (
            v.symbol,
            _MEANING.get(v.symbol, ""),
            v.where,
            mm(MM * v.value).replace("-", "−"),
            str(v.cycles),
        )
        for v in iso.values
    )
    table = Table(
        "iso9283",
        "Criteria",
        ("criterion", "meaning", "where", "value [mm]", "n"),
        rows,
        "AP, RP: P1 to P5 of the cube; AT, RT: largest over the path. Formulas from general "
        "knowledge of ISO 9283:1998.",
        words=(0, 1, 2),
    )
    return Section("iso9283", title, text, (table,))
