"""`delta-cal certificate`: write a calibration certificate to be signed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from delta_calibration.calibration_file import load_calibration
from delta_calibration.cli.check import warn_of_mistakes
from delta_calibration.cli.fit import describe_poses
from delta_calibration.cli.options import (
    SESSION,
    calibration_option,
    require_folder,
    robot_option,
    seed_option,
    topics_option,
    write_json,
)
from delta_calibration.cli.quantity import Quantity
from delta_calibration.cli.verb import OUTPUT, verb
from delta_calibration.data import Session, collect
from delta_calibration.documents import check_document, load_schema
from delta_calibration.errors import DataError, InputError, MistakeError
from delta_calibration.estimation import identify
from delta_calibration.recording import Topics, read_session
from delta_calibration.report import (
    Certificate,
    Decision,
    examined_by,
    examined_fit,
    page_of_certificate,
    pdf_of,
    read_about,
    require_libraries,
    require_stated,
    require_valid,
    session_provenance,
    write_dcc,
    write_page,
    write_pdf,
)
from delta_calibration.robot import Robot, load_robot
from delta_calibration.texts import read_text

PATH = click.Path(path_type=Path)
_KINDS = (".html", ".pdf", ".json", ".xml")


@verb("certificate")
@SESSION
@robot_option
@click.option(
    "--out",
    "outs",
    type=OUTPUT,
    multiple=True,
    required=True,
    help="File to write; its ending selects the format: .html, .pdf, .json or .xml (a Digital "
    "Calibration Certificate). May be repeated; the JSON is always written beside the "
    "others.",
)
@click.option(
    "--dcc-schema",
    type=PATH,
    default=None,
    metavar="FOLDER",
    help="Folder with PTB's schema (dcc.xsd and the files it imports) for validating the .xml.",
)
@calibration_option(
    "Calibration to certify with this session. Without it, the session itself is fitted."
)
@click.option(
    "--about",
    type=PATH,
    default=None,
    help="YAML file with what the session does not contain: machine, instrument, operator, "
    "ambient conditions, tolerance (docs/certificate.md).",
)
@click.option(
    "--tolerance",
    "tolerance_mm",
    type=Quantity(0, 1000, above=True),
    default=None,
    metavar="MM",
    help="Largest permitted 3-D error; conformity is decided by ISO 14253-1.",
)
@click.option("--number", default=None, help="Number of the certificate.")
@click.option("--machine", default=None, help="Model of the machine.")
@click.option("--serial", default=None, help="Serial number of the machine.")
@click.option("--instrument", default=None, help="Model of the tracker.")
@click.option("--instrument-serial", default=None, help="Serial number of the tracker.")
@click.option(
    "--instrument-certificate",
    default=None,
    help="Number of the tracker's own calibration certificate.",
)
@click.option("--operator", default=None, help="Name of the person who measured.")
@click.option(
    "--ambient",
    type=Quantity(-40, 80),
    default=None,
    metavar="DEGREES",
    help="Ambient temperature [deg C].",
)
@seed_option
@topics_option
def command(
    session: Path,
    robot_file: str,
    outs: tuple[Path, ...],
    dcc_schema: Path | None,
    calibration_file: Path | None,
    about: Path | None,
    seed: int,
    topics: tuple[str, ...],
    **given: Any,
) -> None:
    """Certify a calibration from the poses at rest in SESSION.

    The certificate contains: machine, instrument and conditions from --about or the options
    (anything missing is printed as "not stated"); the dimensions with deviation and U (k = 2), and
    those that the session does not identify; every measured point with its error before and after,
    U and the decision; the 95 % radius of a corrected position anywhere in the region; the
    uncertainty budget by the GUM; a signature block; statistics and provenance as an appendix.

    The decision follows ISO 14253-1: a point passes if error + U <= tolerance, fails if error - U
    > tolerance, and is undecided otherwise. Without --calibration every point is judged by a fit
    that has not seen it. With --calibration only the tracker's frame is fitted to SESSION; if the
    calibration was made from this very session, no point can pass.

    The exit code is 1 if a tolerance is given and not met by every point; the certificate is
    written all the same.
    """
    for out in outs:
        require_folder(out)
        if out.suffix not in _KINDS:
            raise InputError(f"--out {out}: the ending selects the format: {', '.join(_KINDS)}")
    for beside in {out.with_suffix(".json") for out in outs} - {*outs}:
        _require_certificate(beside)
    if any(out.suffix == ".html" for out in outs):
        require_libraries()
    stated = read_about(about, _by_path(given))
    digital = any(out.suffix == ".xml" for out in outs)
    if digital:
        require_stated(stated)
    robot = load_robot(robot_file)
    recorded = read_session(session, Topics.from_options(topics))
    _require_sound(recorded, robot, robot_file)
    poses = collect(recorded, robot.joints.names, robot.commanded.joint_size)
    calibration = None if calibration_file is None else load_calibration(calibration_file, robot)
    if digital:
        require_stated(stated, poses.start_ns)
    seeded = "fit" if calibration is None else ""
    source = session_provenance(
        session, poses, robot, seed, recorded.metadata, calibration, seeded
    )
    click.echo(describe_poses(poses))
    if calibration is None:
        examined = examined_fit(identify(poses, robot, seed=seed), poses, robot)
    else:
        examined = examined_by(calibration, poses, robot)
    certificate = Certificate(examined, stated, source)
    _write(certificate, outs, dcc_schema)
    _require_passed(certificate, session)


def _require_certificate(path: Path) -> None:
    """Refuse to overwrite a JSON file, which the user did not name, unless it is a certificate.

    Raises:
        InputError: it is another file.
    """
    if not path.exists():
        return
    try:
        check_document(json.loads(read_text(path)), load_schema("certificate"), str(path))
    except (ValueError, InputError) as error:
        raise InputError(
            f"{path}: the certificate's JSON would replace this file, which is no certificate; "
            "choose another name for --out"
        ) from error


def _require_sound(recorded: Session, robot: Robot, robot_file: str) -> None:
    """Refuse to certify by a session that was recorded with a mistake.

    Raises:
        MistakeError: a mistake was found.
    """
    try:
        warn_of_mistakes(recorded, robot, robot_file, force=False, out=True)
    except MistakeError as error:
        raise MistakeError(
            f"{recorded.source}: a session with a mistake cannot be certified: `delta-cal check` "
            "explains it, and --fix corrects it if it is known well enough"
        ) from error


_OPTIONS = {
    "tolerance_mm": "tolerance_mm",
    "number": "number",
    "machine": "machine.model",
    "serial": "machine.serial",
    "instrument": "instrument.model",
    "instrument_serial": "instrument.serial",
    "instrument_certificate": "instrument.certificate",
    "operator": "operator",
    "ambient": "ambient.temperature_c",
}


def _by_path(given: dict[str, Any]) -> dict[str, Any]:
    return {_OPTIONS[name]: value for name, value in given.items()}


def _write(certificate: Certificate, outs: tuple[Path, ...], dcc_schema: Path | None) -> None:
    """Write all files and print their names."""
    page = page_of_certificate(certificate)
    click.echo(page.sentence)
    beside = {out.with_suffix(".json") for out in outs}
    # a PDF that cannot be made fails before any file is written; a DCC, which its schema may
    # refuse, is written before the others
    made = {path: pdf_of(page) for path in outs if path.suffix == ".pdf"}
    for path in sorted({*outs, *beside}, key=lambda path: (path.suffix != ".xml", path)):
        if path.suffix == ".html":
            write_page(path, page)
        elif path.suffix == ".pdf":
            write_pdf(path, made[path])
        elif path.suffix == ".xml":
            write_dcc(path, certificate)
        else:
            write_json(path, certificate.as_dict())
        click.echo(f"written: {path}")
        if path.suffix == ".xml":
            click.echo(_checked(path, dcc_schema))


def _checked(path: Path, dcc_schema: Path | None) -> str:
    """Validate a DCC by its schema and return the result in words.

    Raises:
        DataError: it is not valid.
    """
    if dcc_schema is None:
        return (
            f"not validated: {path}: PTB's schema is not part of this package (give it by "
            "--dcc-schema)"
        )
    require_valid(path, dcc_schema)
    return f"valid according to the schema in {dcc_schema}: {path}"


def _require_passed(certificate: Certificate, session: Path) -> None:
    """Fail if a tolerance is given and not met.

    Raises:
        DataError: the decision is `fail` or `not decided`.
    """
    decision = certificate.decision
    if decision not in (None, Decision.PASS):
        raise DataError(f"{session}: {page_of_certificate(certificate).sentence}")
