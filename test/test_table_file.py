"""The file of a table is read back unchanged; anything else is refused with the reason."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.calibration import Calibration
from delta_calibration.chain import Chain
from delta_calibration.compensation import Table, load_table, save_table
from delta_calibration.compensation.table import Stamp
from delta_calibration.compensation.table_file import _hash
from delta_calibration.documents import content_hash
from delta_calibration.errors import ConfigError
from delta_calibration.geometry import Frame
from delta_calibration.region import Region
from delta_calibration.robot import load_robot

ROBOT = load_robot("srbd")
RNG = np.random.default_rng(3)


def calibration() -> Calibration:
    mechanism = ROBOT.model("rotary_delta")
    chain = Chain(mechanism, np.zeros(3), 0.05)
    theta = chain.join(mechanism.parameters.nominal, np.zeros(3), Frame.identity())
    region = Region.of(RNG.uniform(-0.1, 0.1, (9, 3)) - [0, 0, 0.7])
    lower, upper = ROBOT.joints.lower, ROBOT.joints.upper
    return Calibration(ROBOT, chain, theta, region, lower, upper, 1e-5, "made", "c" * 64)


MADE = calibration()
TABLE = Table(
    lower=np.array([-0.1, 0.2, 1 / 3]),
    upper=np.array([0.9, 1.1, 1.3]),
    corrections=RNG.normal(0, 1e-3, (6, 6, 6, 3)),
    stamp=Stamp.of(MADE),
    solver="apso",
    bound=1e-6,
    worst=4.2e-7,
    checked=1234,
)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "table.npz"
    save_table(path, TABLE)
    return path


def same(left: Table, right: Table) -> bool:
    plain = ("stamp", "solver", "bound", "worst", "checked", "bend")
    arrays = ("lower", "upper", "corrections")
    return all(getattr(left, n) == getattr(right, n) for n in plain) and all(
        np.array_equal(getattr(left, n), getattr(right, n)) for n in arrays
    )


def rewritten(
    path: Path, change: Callable[[dict], None], corrections: np.ndarray | None = None
) -> None:
    """Write the file with another header and other corrections, and new hashes."""
    with np.load(path, allow_pickle=False) as archive:
        header, values = json.loads(str(archive["header"])), archive["corrections"]
    values = values if corrections is None else corrections
    header["corrections_sha256"] = _hash(values)
    change(header)
    content = {key: value for key, value in header.items() if key != "sha256"}
    header["sha256"] = content_hash(content)
    np.savez(path, header=np.array(json.dumps(header)), corrections=values)


def refused(path: Path, made: Calibration = MADE) -> str:
    with pytest.raises(ConfigError) as caught:
        load_table(path, made)
    said = str(caught.value)
    assert said.startswith(f"{path}: ")
    assert "\n" not in said
    return said


def test_what_was_written_comes_back(file: Path) -> None:
    found = load_table(file, MADE)
    assert same(found, TABLE)
    q = RNG.uniform(TABLE.lower, TABLE.upper, (50, 3))
    np.testing.assert_array_equal(found.at(q), TABLE.at(q))
    assert [p.name for p in file.parent.iterdir()] == [file.name]  # no temporary file is left


def test_the_file_says_what_it_is_without_the_package(file: Path) -> None:
    with np.load(file, allow_pickle=False) as archive:
        header = json.loads(str(archive["header"]))
        assert archive["corrections"].shape == (6, 6, 6, 3)
    assert header["made_for"]["calibration_sha256"] == MADE.seal
    assert header["made_for"]["robot_sha256"] == ROBOT.hash
    assert header["error"] == {"bound_m": 1e-6, "worst_m": 4.2e-7, "places": 1234}
    assert header["axes"]["nodes"] == 6


def test_a_rewritten_file_is_no_different(file: Path) -> None:
    rewritten(file, lambda header: None)
    assert same(load_table(file, MADE), TABLE)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            {"seal": "d" * 64},
            "made for calibration cccccccccccc, but the current one is dddddddddddd",
        ),
        ({"robot": replace(ROBOT, hash="e" * 64)}, "the current one is eeeeeeeeeeee"),
        ({"robot": replace(ROBOT, tool_offset=np.array([0, 0, -0.1]))}, "made for tool [m] "),
    ],
)
def test_a_stale_table_is_refused(file: Path, change: dict, said: str) -> None:
    found = refused(file, replace(MADE, **change))
    assert "the table is outdated: " in found
    assert said in found
    assert found.endswith("compute it again")


def test_a_file_that_is_cut_anywhere_is_refused(file: Path) -> None:
    whole = file.read_bytes()
    for length in [0, 1, 20, *range(100, len(whole), 400), len(whole) - 1]:
        file.write_bytes(whole[:length])
        assert "not a whole table of corrections" in refused(file)


def test_a_byte_that_changed_is_refused_or_does_not_matter(file: Path) -> None:
    whole, turned = file.read_bytes(), 0
    places = [*range(0, 200), *np.random.default_rng(1).integers(0, len(whole), 200)]
    for place in [*places, *range(len(whole) - 200, len(whole))]:
        bad = bytearray(whole)
        bad[place] ^= 0x55
        file.write_bytes(bytes(bad))
        try:
            found = load_table(file, MADE)
        except ConfigError:  # any other exception fails the test
            turned += 1
        else:
            assert same(found, TABLE)
    assert turned > 300


def test_corrections_that_are_not_the_headers_are_refused(file: Path) -> None:
    with np.load(file, allow_pickle=False) as archive:
        header, values = archive["header"], archive["corrections"].copy()
    values[2, 3, 4, 1] += 1e-9
    np.savez(file, header=header, corrections=values)
    assert "changed or cut off after it was written" in refused(file)
    other = np.array(str(header).replace("0.9", "0.8"))
    np.savez(file, header=other, corrections=TABLE.corrections)
    assert "changed or cut off after it was written" in refused(file)


@pytest.mark.parametrize(
    ("corrections", "said"),
    [
        (np.zeros((6, 6, 6, 2)), "shape (6, 6, 6, 2); by the header it has to be (6, 6, 6, 3)"),
        (np.zeros((7, 7, 7, 3)), "have shape (7, 7, 7, 3); by the header"),
        (np.zeros(648), "have shape (648,); by the header"),
        (np.full((6, 6, 6, 3), np.inf), "corrections hold values that are not finite"),
        (np.zeros((6, 6, 6, 3), dtype=np.float32), "corrections are float32; they have to be"),
        (np.zeros((6, 6, 6, 3), dtype=">f8"), "corrections are >f8; they have to be"),
    ],
)
def test_corrections_of_another_form_are_refused(
    file: Path, corrections: np.ndarray, said: str
) -> None:
    rewritten(file, lambda header: None, corrections)
    assert said in refused(file)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda h: h.update(schema=2), "header: schema: 2 is not allowed; it must be 1"),
        (lambda h: h.pop("axes"), "header: missing key axes"),
        (lambda h: h.update(more=1), "header: unknown key more"),
        (lambda h: h.update(solver="table"), "header: solver: 'table' is not allowed"),
        (lambda h: h["axes"].update(bend=0), "header: axes.bend: 0 is not allowed"),
        (lambda h: h["axes"].update(lower_rad=[0, 1]), "axes.lower_rad: 2 values found"),
        (lambda h: h["axes"].update(upper_rad=[-0.2, 2, 2]), "no grid of three joints"),
        (lambda h: h["axes"].update(nodes=7), "by the header it has to be (7, 7, 7, 3)"),
        (lambda h: h["error"].update(bound_m=1e-3), "error.bound_m: 0.001 is not allowed"),
        (lambda h: h["error"].update(worst_m=float("inf")), "worst_m: inf is not a finite"),
        (lambda h: h["made_for"].update(robot_sha256="f" * 64), "the table is outdated"),
    ],
)
def test_headers_that_are_none_are_refused(
    file: Path, change: Callable[[dict], None], said: str
) -> None:
    rewritten(file, change)
    assert said in refused(file)


def archive_of(**members: object) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **members)
    return buffer.getvalue()


def array_file() -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, np.zeros(3))
    return buffer.getvalue()


def text_archive() -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("header", '{"schema": 1}')
    return buffer.getvalue()


FOREIGN = {
    "text": b"x_mm,y_mm,z_mm\n1,2,3\n",
    "array": array_file(),
    "other members": archive_of(a=np.zeros(3)),
    "no corrections": archive_of(header=np.array("{}")),
    "no JSON": archive_of(header=np.array("schema: 1"), corrections=np.zeros(3)),
    "deep JSON": archive_of(header=np.array("[" * 100_000), corrections=np.zeros(3)),
    "text in an archive": text_archive(),
    # pickled objects are never loaded
    "objects": archive_of(header=np.array([{"schema": 1}], dtype=object), corrections=TABLE.lower),
}


@pytest.mark.parametrize("kind", FOREIGN)
def test_files_of_another_kind_are_refused(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "table.npz"
    path.write_bytes(FOREIGN[kind])
    assert "not a whole table of corrections" in refused(path)


def test_a_header_that_is_no_mapping_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "table.npz"
    path.write_bytes(archive_of(header=np.array("[1, 2]"), corrections=np.zeros(3)))
    assert "header: a mapping of keys to values is expected, found a list" in refused(path)


def test_no_file_and_no_folder(tmp_path: Path) -> None:
    assert "cannot be read: No such file" in refused(tmp_path / "none.npz")
    assert "cannot be read: Is a directory" in refused(tmp_path)
    with pytest.raises(ConfigError, match="cannot be written: No such file"):
        save_table(tmp_path / "none" / "table.npz", TABLE)
