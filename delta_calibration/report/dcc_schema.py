"""Whether a Digital Calibration Certificate keeps to PTB's schema, where that is at hand.

The schema is PTB's and does not come with this package: a folder is given that holds dcc.xsd and
what it imports (SI_Format.xsd of the D-SI with its own imports, xmldsig-core-schema.xsd).
"""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from xml.etree import ElementTree

from delta_calibration.errors import ConfigError, DataError, InputError
from delta_calibration.report.dcc import DCC
from delta_calibration.report.missing import required

_TOLD = 5  # complaints of the schema
_MOST = 4_000_000  # bytes of a schema's file


def require_valid(path: Path, folder: Path) -> None:
    """Refuse a file that does not keep to the schema.

    Args:
        path: of the certificate.
        folder: of the schema's files, searched with its sub-folders.

    Raises:
        InputError: the library is not installed, or the folder holds no schema of the DCC.
        ConfigError: a file of it is no schema.
        DataError: the certificate breaks it; the first complaints are told.
    """
    xmlschema = required("xmlschema", "--dcc-schema")
    files = _by_namespace(folder)
    if DCC not in files:
        raise InputError(f"--dcc-schema {folder}: no schema of {DCC} (dcc.xsd) in it")
    others = {space: str(file) for space, file in files.items() if space != DCC}
    try:
        schema = xmlschema.XMLSchema(str(files[DCC]), locations=others, allow="local")
    except (xmlschema.XMLSchemaException, OSError) as error:
        first = str(error).strip().splitlines()[0]
        raise ConfigError(f"--dcc-schema {files[DCC]}: {first}") from error
    wrong = [
        f"{fault.path}: {fault.reason}" for fault in islice(schema.iter_errors(str(path)), _TOLD)
    ]
    if wrong:
        raise DataError(f"{path}: not as {files[DCC]} asks: " + "; ".join(wrong))


def _by_namespace(folder: Path) -> dict[str, Path]:
    """Schema files of a folder, by what they define."""
    found: dict[str, Path] = {}
    for file in sorted(folder.rglob("*.xsd")):
        if file.is_file() and file.stat().st_size <= _MOST:
            try:
                space = ElementTree.parse(file).getroot().get("targetNamespace")
            except ElementTree.ParseError as error:
                raise ConfigError(f"--dcc-schema {file}: no XML: {error}") from error
            if space:
                found.setdefault(space, file)
    return found
