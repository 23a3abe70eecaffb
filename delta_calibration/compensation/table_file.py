"""The file of a table: a JSON header and the corrections at the nodes, nothing that is executed.

One npz archive, as any numpy reads it without pickle: `header`, the JSON text, says what the table
was made for, its axes and the error that was found in it, under a schema as the other documents;
`corrections` (k, k, k, 3) [rad] are the nodes' values, from which the splines follow. The header
carries the hash of the corrections and its own.
"""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from delta_calibration import __version__
from delta_calibration.calibration import Calibration
from delta_calibration.compensation.base import Array
from delta_calibration.compensation.table import Stamp, Table
from delta_calibration.documents import check_document, content_hash, load_schema
from delta_calibration.errors import ConfigError, InputError
from delta_calibration.files import opened, written_whole

_MOST = 4 << 30  # bytes: 500 nodes along each of three axes
_SEAL = "sha256"
_UNREADABLE = (  # raised by numpy, zip and JSON for a file of another format or an incomplete one
    OSError,
    ValueError,
    EOFError,
    KeyError,
    TypeError,
    AttributeError,
    NotImplementedError,
    RecursionError,
    MemoryError,
    BadZipFile,
    zlib.error,
)


def save_table(path: Path, table: Table) -> None:
    """Write a table, whole or not at all.

    Raises:
        ConfigError: the file cannot be written.
    """
    content = _content(table)
    header = json.dumps({**content, _SEAL: content_hash(content)}, allow_nan=False)
    with (
        written_whole(path, ConfigError, lasting=True) as beside,
        beside.open("wb") as file,
    ):
        np.savez(file, header=np.array(header), corrections=table.corrections)


def load_table(path: Path, calibration: Calibration) -> Table:
    """Read a table made for this calibration.

    Raises:
        ConfigError: not there, not whole, changed after it was written, or made for another
            calibration, robot or tool.
    """
    header, corrections = _read(path)
    check_document(header, load_schema("table"), f"{path}: header")
    content = {key: value for key, value in header.items() if key != _SEAL}
    whole = content_hash(content) == header[_SEAL]
    if not whole or _hash(corrections) != header["corrections_sha256"]:
        raise ConfigError(
            f"{path}: {_SEAL}: the file was changed or cut off after it was "
            "written; compute it again"
        )
    try:
        table = _table(header, corrections)
        table.stamp.require(calibration)
    except InputError as error:
        raise ConfigError(f"{path}: {error}") from error
    return table


def _content(table: Table) -> dict[str, Any]:
    """Return the header without its seal."""
    stamp = table.stamp
    return {
        "schema": 1,
        "package_version": __version__,
        "made_for": {
            "calibration_sha256": stamp.calibration,
            "robot_sha256": stamp.robot,
            "model": stamp.model,
            "tool_m": list(stamp.tool),
        },
        "solver": table.solver,
        "axes": {
            "lower_rad": table.lower.tolist(),
            "upper_rad": table.upper.tolist(),
            "bend": table.bend,
            "nodes": table.nodes,
        },
        "error": {
            "bound_m": table.bound,
            "worst_m": float(table.worst),
            "places": table.checked,
        },
        "corrections_sha256": _hash(table.corrections),
    }


def _table(header: Mapping[str, Any], corrections: Array) -> Table:
    """Build the table from a header and its corrections."""
    axes, error, made_for = header["axes"], header["error"], header["made_for"]
    nodes = axes["nodes"]
    if corrections.shape != (nodes, nodes, nodes, 3):
        raise InputError(
            f"corrections have shape {corrections.shape}; by the header it has to be "
            f"({nodes}, {nodes}, {nodes}, 3)"
        )
    return Table(
        lower=np.array(axes["lower_rad"], dtype=float),
        upper=np.array(axes["upper_rad"], dtype=float),
        corrections=corrections,
        stamp=Stamp(
            calibration=made_for["calibration_sha256"],
            robot=made_for["robot_sha256"],
            model=made_for["model"],
            tool=tuple(map(float, made_for["tool_m"])),
        ),
        solver=header["solver"],
        bound=error["bound_m"],
        worst=error["worst_m"],
        checked=error["places"],
        bend=axes["bend"],
    )


def _read(path: Path) -> tuple[Any, Array]:
    """Header and corrections of an archive."""
    try:
        with opened(path, _MOST, ConfigError) as file, np.load(file) as archive:
            header = json.loads(str(archive["header"]))
            corrections = archive["corrections"]
    except (FileNotFoundError, IsADirectoryError, PermissionError) as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except _UNREADABLE as error:
        what = " ".join(str(error).split())
        raise ConfigError(f"{path}: not a whole table of corrections: {what}") from error
    if corrections.dtype != np.float64:
        raise ConfigError(f"{path}: corrections are {corrections.dtype}; they have to be float64")
    return header, corrections


def _hash(corrections: Array) -> str:
    """SHA-256 of the corrections as little-endian bytes."""
    return hashlib.sha256(np.ascontiguousarray(corrections, dtype="<f8").tobytes()).hexdigest()
