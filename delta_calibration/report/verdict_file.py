"""Reading of verdict files written by `diagnose --json`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from delta_calibration.diagnosis.verdict import (
    Action,
    CannotTell,
    Estimate,
    Finding,
    FoundEquation,
    Held,
    SessionFacts,
    UnknownStructure,
    Verdict,
)
from delta_calibration.documents import check_document, load_schema
from delta_calibration.errors import InputError
from delta_calibration.texts import read_text


@dataclass(frozen=True)
class VerdictFile:
    """A verdict and the file it was read from."""

    name: str
    verdict: Verdict


def read_verdict(path: Path) -> VerdictFile:
    """Read a verdict from its JSON file.

    Raises:
        InputError: the file cannot be read, is not JSON, or does not match the verdict's schema.
    """
    try:
        data = json.loads(read_text(path))
    except ValueError as error:
        raise InputError(f"{path}: not JSON: {error}") from error
    check_document(data, load_schema("verdict"), str(path))
    return VerdictFile(path.stem, verdict_of(data))


def verdict_of(data: Mapping[str, Any]) -> Verdict:
    """Convert the output of `Verdict.as_dict` back to a verdict."""
    unknown = data["unknown_structure"]
    return Verdict(
        session=SessionFacts(**{k: data["session"][k] for k in SessionFacts.__annotations__}),
        noise_mm=data["noise_mm"],
        baseline=_held(data["baseline"]),
        calibrated=_held(data["calibrated"]),
        extended=_held(data["extended"]),
        findings=tuple(_finding(entry) for entry in data["findings"]),
        unknown_structure=UnknownStructure(
            unknown["found"],
            unknown.get("where"),
            unknown.get("moves_with"),
            unknown.get("rms_mm"),
            unknown["tests"],
            tuple(_equation(law) for law in unknown.get("laws", ())),
        ),
        cannot_tell=tuple(
            CannotTell(tuple(e["between"]), e["because"], e["next"]) for e in data["cannot_tell"]
        ),
    )


def _equation(data: Mapping[str, Any]) -> FoundEquation:
    return FoundEquation(
        stage=data["stage"],
        part=data["part"],
        variables=tuple(data["variables"]),
        equation=data["equation"],
        values=_estimates(data["values"]),
        probability=data["probability"],
        rival=data.get("rival"),
        separated_by=data.get("separated_by"),
        region={name: (low, high) for name, (low, high) in data.get("region", {}).items()},
    )


def _estimates(data: Mapping[str, Any]) -> dict[str, Estimate]:
    return {name: Estimate(p["value"], p["std"], p["unit"]) for name, p in data.items()}


def _held(data: Mapping[str, Any]) -> Held:
    return Held(data["model"], data["held_out_rms_mm"], data.get("with_set_aside_rms_mm"))


def _finding(data: Mapping[str, Any]) -> Finding:
    """Convert a finding; not every verdict contains the interval of the gain and the signal."""
    return Finding(
        cause=data["cause"],
        location=data["location"],
        kind=data["kind"],
        equivalents=tuple(data["equivalents"]),
        separated_by=data.get("separated_by"),
        parameters=_estimates(data["parameters"]),
        confidence=data["confidence"],
        p_value=data["p_value"],
        rms_before_mm=data["rms_before_mm"],
        rms_after_mm=data["rms_after_mm"],
        gain=data["gain"],
        gain_low=data.get("gain_low", data["gain"]),
        gain_high=data.get("gain_high", data["gain"]),
        signal=data.get("signal", 0.0),
        shape=_shape(data),
        action=_action(data.get("action")),
    )


def _shape(data: Mapping[str, Any]) -> dict[str, Estimate | str]:
    """Convert the shape parameters of a finding."""
    std, unit = data.get("shape_std", {}), data.get("shape_unit", {})
    return {
        name: value
        if isinstance(value, str)
        else Estimate(value, std.get(name), unit.get(name, ""))
        for name, value in data.get("shape", {}).items()
        if value is not None
    }


def _action(data: Mapping[str, Any] | None) -> Action | None:
    if data is None:
        return None
    left, confirm = data.get("held_out_rms_after_mm"), data.get("confirm")
    how = data.get("how", "")
    return Action(data["do"], data.get("part") or "", left, confirm or "", how)
