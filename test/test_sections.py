"""Sections of a file: keys with units, arrays, nested parts, refusals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from delta_calibration.documents import check_document
from delta_calibration.errors import ConfigError
from delta_calibration.sections import (
    built,
    choice,
    length,
    names,
    place,
    quantity,
    schema_of,
    tolerance,
)


@dataclass(frozen=True)
class Strut:
    length: float = length()
    twist: float = tolerance("mrad", default=0.0)


@dataclass(frozen=True)
class Frame:
    struts: tuple[str, ...] = names()
    kind: str = choice("open", "closed")
    anchors: np.ndarray = place(shape=(None, 3))
    lead: float = quantity("turns_per_m", above=0.0)
    first: Strut = None  # type: ignore[assignment]


TEXT = {
    "struts": ["a", "b"],
    "kind": "open",
    "anchors_mm": [[1, 2.0, 3], [4, 5, 6]],
    "lead_turns_per_m": 200.0,
    "first": {"length_mm": 120},
}


def test_a_section_is_in_si_with_its_arrays_and_parts() -> None:
    check_document(TEXT, schema_of(Frame), "here")
    frame = built(Frame, TEXT)
    assert frame.struts == ("a", "b")
    assert frame.kind == "open"
    np.testing.assert_allclose(frame.anchors, [[1e-3, 2e-3, 3e-3], [4e-3, 5e-3, 6e-3]])
    assert frame.lead == pytest.approx(400 * np.pi)
    assert frame.first == Strut(0.12, 0.0)


@pytest.mark.parametrize(
    ("entry", "value", "said"),
    [
        ("kind", "ajar", "kind: 'ajar' is not allowed; choose from: open, closed"),
        ("anchors_mm", [[1, 2]], r"anchors_mm\[0\]: 2 values found, 3 are"),
        ("anchors_mm", [[1, 2, "x"]], r"anchors_mm\[0\]\[2\]: 'x' is not allowed; a number"),
        ("lead_turns_per_m", 0, "lead_turns_per_m: 0 is not allowed; more than 0 is"),
        ("first", {"length_mm": 1, "twist_mrad": -1}, r"first\.twist_mrad: -1 .* more than 0"),
        ("first", {"size_mm": 1}, "first: "),
        ("anchors", [], "unknown key anchors"),
    ],
)
def test_what_a_section_may_not_say(entry: str, value: object, said: str) -> None:
    with pytest.raises(ConfigError, match=f"^here: {said}"):
        check_document({**TEXT, entry: value}, schema_of(Frame), "here")


def test_what_is_missing_is_named() -> None:
    without = {key: value for key, value in TEXT.items() if key != "anchors_mm"}
    with pytest.raises(ConfigError, match="missing key anchors_mm"):
        check_document(without, schema_of(Frame), "here")
