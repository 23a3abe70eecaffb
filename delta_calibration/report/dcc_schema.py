"""Validation of a Digital Calibration Certificate against PTB's schema.

The schema is not part of this package: the user gives a folder with dcc.xsd and the schemas that
it imports (SI_Format.xsd of the D-SI with its own imports, xmldsig-core-schema.xsd).
"""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from xml.etree import ElementTree

from delta_calibration.errors import ConfigError, DataError, InputError
from delta_calibration.report.dcc import DCC
from delta_calibration.report.missing import required

_TOLD = 5  # largest number of violations reported
_MOST = 4_000_000  # largest size of a schema file [bytes]


def require_valid(path: Path, folder: Path) -> None:
    """Refuse a file that violates the schema.

    Args:
        path: file of the certificate.
        folder: folder of the schema files, searched with its sub-folders.

    Raises:
        InputError: the library is not installed, or the folder contains no schema of the DCC.
        ConfigError: a file of the folder is no valid schema.
        DataError: the certificate violates the schema; names the first violations.
    """
    xmlschema = required("xmlschema", "--dcc-schema")
    files = _by_namespace(folder)
    if DCC not in files:
        raise InputError(f"--dcc-schema {folder}: contains no schema of {DCC} (dcc.xsd)")
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
        raise DataError(f"{path}: does not conform to {files[DCC]}: " + "; ".join(wrong))


def _by_namespace(folder: Path) -> dict[str, Path]:
    """Schema files of a folder, by their target namespace."""
    found: dict[str, Path] = {}
    for file in sorted(folder.rglob("*.xsd")):
        if file.is_file() and file.stat().st_size <= _MOST:
            try:
                space = ElementTree.parse(file).getroot().get("targetNamespace")
            except ElementTree.ParseError as error:
                raise ConfigError(f"--dcc-schema {file}: not XML: {error}") from error
            if space:
                found.setdefault(space, file)
    return found
