"""What an existing file is, and whether a verb may write its result over it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from delta_calibration.errors import InputError

_READ = 1 << 16  # bytes from which the kind is recognised
_RECORDING = "a recording"
_DATABASE = "a database (a recording or a history)"
_METADATA = "the metadata of a recording"
_ROBOT = "a robot file"
_CALIBRATION = "a calibration"
_JSON = "a JSON file"
_PAGE = "a page (HTML)"
_OTHER = "a file of another kind"

# what a file of the kind begins with or contains; the first that matches
_SIGNS: Mapping[str, re.Pattern[bytes]] = {
    _RECORDING: re.compile(rb"\A\x89MCAP"),
    _DATABASE: re.compile(rb"\ASQLite format 3"),
    _JSON: re.compile(rb"\A\s*[{\[]"),
    _PAGE: re.compile(rb"\A\s*<(!doctype )?html", re.IGNORECASE),
    _METADATA: re.compile(rb"^rosbag2_bagfile_information:", re.MULTILINE),
    _ROBOT: re.compile(rb"^mechanism:", re.MULTILINE),
    _CALIBRATION: re.compile(
        rb"\A(?=.*^model:)(?=.*^robot:)(?=.*^provenance:)", re.MULTILINE | re.DOTALL
    ),
}
_BY_VERB: Mapping[tuple[str, str], str] = {
    ("fit", "--out"): _CALIBRATION,
    ("diagnose", "--out"): _CALIBRATION,
    ("report", "--out"): _PAGE,
}
_BY_OPTION: Mapping[str, str] = {"--json": _JSON, "--verdict": _JSON, "--report": _PAGE}
# replaced by no result whose kind is not listed above
_KEPT = {_RECORDING, _DATABASE, _METADATA, _CALIBRATION, _ROBOT}


def require_same_kind(verb: str, option: str, path: Path) -> None:
    """Refuse to write a result over an existing file of another kind.

    Args:
        verb: name of the verb, such as `fit`.
        option: that names the file, such as `--out`.
        path: the file to write.

    Raises:
        InputError: names the option, the file, what it is, and what may be done.
    """
    found, wanted = _kind_of(path), _BY_VERB.get((verb, option), _BY_OPTION.get(option))
    if found is None or found == wanted or (wanted is None and found not in _KEPT):
        return
    written = f", not {wanted}" if wanted else ""
    raise InputError(
        f"{option} {path}: exists and is {found}{written}; name another file, or replace it "
        "with --force"
    )


def _kind_of(path: Path) -> str | None:
    """Kind of an existing file; None if there is none, it is empty or cannot be read."""
    try:
        if not path.is_file():
            return None
        with path.open("rb") as file:
            begun = file.read(_READ)
    except (OSError, ValueError):  # what is written there tells why
        return None
    if not begun.strip():
        return None
    return next((kind for kind, sign in _SIGNS.items() if sign.search(begun)), _OTHER)
