"""Hostile input: damaged and forged files and messages raise only the package's own errors.

Every input is made from a valid one, by damage to its bytes or by a hostile value. A calibration
is sealed again, so that the code after the check of the seal is reached. The draws are the same in
every run. An alarm ends tests that hang, and the peak of memory is checked.
"""

from __future__ import annotations

import resource
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import deepcopy
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from openpyxl import Workbook
from ruamel.yaml import YAML

from delta_calibration.calibration_file import load_calibration, save_calibration
from delta_calibration.data import collect
from delta_calibration.documents import content_hash
from delta_calibration.drafting import robot_from_urdf
from delta_calibration.errors import CalibrationError
from delta_calibration.estimation import identify
from delta_calibration.plans import make_plan, read_plan
from delta_calibration.plans.target_file import read_rows, targets_of
from delta_calibration.recording import read_session, write_session
from delta_calibration.recording.info import inspect_session
from delta_calibration.recording.klipper import read_printer
from delta_calibration.recording.reader import read_messages
from delta_calibration.recording.table_mapping import read_mapping
from delta_calibration.recording.table_session import session_of_table
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session
from extended_bench import with_effects
from import_bench import mapping_of
from recording_helpers import both, foreign_mcap, joints, make_session

ROOT = Path(__file__).parents[1]
SRBD = load_robot("srbd")
HANG_S = 5
MOST_BYTES = 1 << 30


def seeded(count: int) -> settings:
    """This many examples, the same in every run."""
    return settings(
        max_examples=count,
        derandomize=True,
        phases=[Phase.generate],  # a failure is reported at once, without shrinking
        deadline=None,
        database=None,
        suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    )


TOKENS = [
    b"&a [*a, *a]",
    b"*nothing",
    b"!!python/object:os.system x",
    b"<<: *a",
    b"[" * 3000,
    b"{a: " * 500,
    b"\x00",
    b"\xff\xfe",
    b"\xef\xbb\xbf",
    b"1e999",
    b"-.nan",
    b"9" * 5000,
    b"0x" + b"f" * 400,
    b"---\n",
    b"2026-02-30",
    b"1:2:3:4",
    b"? [x]",
    b",,,",
    b'"',
    b"\r",
]
HOSTILE: list[Any] = [
    None,
    True,
    "",
    "\u202e",
    "x" * 10_000,
    "../../../etc/shadow",
    0,
    -1,
    10**400,
    -(2**63),
    5e-324,
    1.7e308,
    float("inf"),
    float("nan"),
    [],
    {},
    [[]],
    [None] * 40,
    [0] * 3,
    [1e300, -1e300, 1e300],
    {"a": {"b": {}}},
]


def damaged(sound: bytes) -> st.SearchStrategy[bytes]:
    """A file with bytes overwritten, removed, duplicated and inserted."""
    at = st.floats(0.0, 1.0)
    change = st.one_of(
        st.tuples(st.just("set"), at, st.binary(min_size=1, max_size=8)),
        st.tuples(st.just("cut"), at, st.integers(1, 200)),
        st.tuples(st.just("end"), at, st.just(0)),
        st.tuples(st.just("again"), at, st.integers(1, 400)),
        st.tuples(st.just("put"), at, st.sampled_from(TOKENS)),
    )
    return st.lists(change, min_size=1, max_size=4).map(lambda steps: _applied(sound, steps))


def _applied(data: bytes, steps: list[Any]) -> bytes:
    for kind, where, what in steps:
        k = int(where * len(data))
        if kind == "set":
            data = data[:k] + what + data[k + len(what) :]
        elif kind == "cut":
            data = data[:k] + data[k + what :]
        elif kind == "end":
            data = data[:k]
        elif kind == "again":
            data = data[: k + what] + data[k:]
        else:
            data = data[:k] + what + data[k:]
    return data


def forged(sound: Any) -> st.SearchStrategy[Any]:
    """A document with hostile values in place of some of its own, or with entries removed."""
    places = list(_places(sound))
    step = st.tuples(st.sampled_from(places), st.sampled_from([*HOSTILE, "GONE"]))
    return st.lists(step, min_size=1, max_size=3).map(lambda steps: _replaced(sound, steps))


def _places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    if path:
        yield path
    entries = value.items() if isinstance(value, dict) else ()
    entries = enumerate(value[:4]) if isinstance(value, list) else entries
    for key, inner in entries:
        yield from _places(inner, (*path, key))


def _replaced(sound: Any, steps: list[Any]) -> Any:
    data = deepcopy(sound)
    for path, value in steps:
        inner = data
        try:
            for key in path[:-1]:
                inner = inner[key]
            if value == "GONE":
                del inner[path[-1]]
            else:
                inner[path[-1]] = deepcopy(value)
        except (KeyError, IndexError, TypeError):
            continue  # an earlier step removed the place
    return data


def text_of(data: Any) -> bytes:
    stream = StringIO()
    YAML(typ="safe").dump(data, stream)
    return stream.getvalue().encode()


@contextmanager
def bounded() -> Iterator[None]:
    """Only the package's own errors, within seconds."""

    def hangs(*_: object) -> None:
        raise AssertionError(f"no end within {HANG_S} s")

    before = signal.signal(signal.SIGALRM, hangs)
    signal.setitimer(signal.ITIMER_REAL, HANG_S)
    try:
        yield
    except CalibrationError as error:
        said = str(error)
        assert said
        assert "Traceback" not in said
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@pytest.fixture(autouse=True)
def memory_fixture() -> Iterator[None]:
    """The peak of this process grows by less than a gigabyte."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    yield
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    assert grown < MOST_BYTES


def use_robot(file: Path) -> None:
    robot = load_robot(file)
    robot.model()


def use_bag(file: Path) -> None:
    for read in (inspect_session, read_session, read_messages):
        with bounded():
            read(file)


ROBOTS = [(ROOT / "config" / f"{name}.yaml").read_bytes() for name in ("srbd", "cdpr8", "ur10")]


@seeded(60)
@given(st.sampled_from(ROBOTS).flatmap(damaged))
def test_a_damaged_robot_file(tmp_path: Path, data: bytes) -> None:
    attempt(tmp_path / "robot.yaml", data, use_robot)


@seeded(80)
@given(st.sampled_from([YAML(typ="safe").load(text) for text in ROBOTS]).flatmap(forged))
def test_a_forged_robot_file(tmp_path: Path, data: Any) -> None:
    attempt(tmp_path / "robot.yaml", text_of(data), use_robot)


def attempt(file: Path, data: bytes, use: Callable[[Path], object]) -> None:
    file.write_bytes(data)
    with bounded():
        use(file)


@pytest.fixture(scope="module", name="calibration")
def calibration_fixture(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A calibration with effects, as the package writes it."""
    machine = draw_machine(SRBD, 5)
    session = simulate_session(machine, make_plan("identify", SRBD, count=15, dwell=0.4), 5)
    poses = collect(session, SRBD.joints.names)
    found = identify(poses, SRBD, "rotary_delta")
    effects = {"backlash": ({}, 1e-4), "transmission_error": ({}, 1e-5)}
    file = tmp_path_factory.mktemp("sound") / "c.yaml"
    save_calibration(file, with_effects(found, SRBD, effects), SRBD, poses)
    return file.read_bytes()


@seeded(60)
@given(data=st.data())
def test_a_forged_calibration(tmp_path: Path, calibration: bytes, data: st.DataObject) -> None:
    sound = YAML(typ="safe").load(calibration)
    content = data.draw(forged({k: v for k, v in sound.items() if k != "sha256"}))
    try:
        content["sha256"] = content_hash(content)
    except (TypeError, ValueError, OverflowError):
        content["sha256"] = sound["sha256"]
    attempt(tmp_path / "c.yaml", text_of(content), lambda file: load_calibration(file, SRBD))


@seeded(40)
@given(data=st.data())
def test_a_damaged_calibration(tmp_path: Path, calibration: bytes, data: st.DataObject) -> None:
    damage = data.draw(damaged(calibration))
    attempt(tmp_path / "c.yaml", damage, lambda file: load_calibration(file, SRBD))


@pytest.fixture(scope="module", name="bags")
def bags_fixture(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    folder = tmp_path_factory.mktemp("bags")
    own = folder / "own"
    write_session(own, make_session(np.random.default_rng(3), 60), {})
    plain = foreign_mcap(folder / "plain.mcap", both(20), chunked=False)
    other = foreign_mcap(folder / "other.mcap", [*both(20), joints(3, names=("a", "a", ""))])
    return [next(own.glob("*.mcap")).read_bytes(), plain.read_bytes(), other.read_bytes()]


@seeded(80)
@given(data=st.data())
def test_a_damaged_bag(tmp_path: Path, bags: list[bytes], data: st.DataObject) -> None:
    damage = data.draw(st.sampled_from(bags).flatmap(damaged))
    attempt(tmp_path / "bag.mcap", damage, use_bag)


@seeded(60)
@given(st.lists(st.binary(max_size=200), min_size=1, max_size=5), st.sampled_from(both(1)))
def test_messages_of_a_bag_that_are_not_what_they_say(
    tmp_path: Path, records: list[bytes], sound: Any
) -> None:
    topic, kind, stamp, _ = sound
    sent = [*both(3), *((topic, kind, stamp + k, r) for k, r in enumerate(records))]
    with bounded():
        use_bag(foreign_mcap(tmp_path / "bag.mcap", sent))


@seeded(40)
@given(data=st.data())
def test_the_metadata_of_a_bag(tmp_path: Path, data: st.DataObject) -> None:
    folder = tmp_path / "bag"
    folder.mkdir(exist_ok=True)
    source = ROOT / "bags" / "linear_delta_plain"
    sound = (source / "metadata.yaml").read_bytes()
    parsed = YAML(typ="safe").load(sound)
    content = data.draw(st.one_of(damaged(sound), forged(parsed).map(text_of)))
    (folder / "linear_delta_plain_0.mcap").write_bytes(
        (source / "linear_delta_plain_0.mcap").read_bytes()[:20_000]
    )
    (folder / "metadata.yaml").write_bytes(content)
    use_bag(folder)


MAPPING = mapping_of()
TABLE = b"q1,q2,q3,x,y,z\n" + b"10,20,30,1.5,2.5,-700\n11,21,31,1.6,2.6,-701\n" * 3


def use_mapping(folder: Path) -> None:
    mapping = read_mapping(folder / "m.yaml", SRBD)
    session_of_table(folder / "t.csv", mapping, SRBD)


@seeded(100)
@given(
    st.one_of(forged(MAPPING).map(text_of), damaged(text_of(MAPPING)), st.just(text_of(MAPPING))),
    st.one_of(damaged(TABLE), st.just(TABLE)),
)
def test_mappings_and_tables(tmp_path: Path, mapping: bytes, table: bytes) -> None:
    (tmp_path / "t.csv").write_bytes(table)
    (tmp_path / "m.yaml").write_bytes(mapping)
    with bounded():
        use_mapping(tmp_path)


POINTS = b"x_mm,y_mm,z_mm,name\n0,0,-750,a\n10,20,-740,b\n-5.5,1e1,-760,c\n"


@seeded(60)
@given(damaged(POINTS))
def test_plans_and_targets(tmp_path: Path, data: bytes) -> None:
    file = tmp_path / "points.csv"
    attempt(file, data, lambda path: targets_of(read_rows(path, SRBD), SRBD))
    attempt(file, data, lambda path: read_plan(path, SRBD, 1.0, (0.0,), 0.0))


PRINTER = b"""[printer]
kinematics: delta
delta_radius: 160.0
[stepper_a]
rotation_distance = 40
microsteps: 16
arm_length: 345.0
position_endstop = 415.0

#*# <---------------------- SAVE_CONFIG ---------------------->
#*# [delta_calibrate]
#*# height0 = 0.1
#*# height0_pos = 33000.000,33001.000,33002.000
#*# distance0 = 60.0
#*# distance0_pos1 = 33000.000,33001.000,33002.000
#*# distance0_pos2 = 33100.000,32901.000,33002.000
"""
ARM = b"""<robot name="arm">
<link name="l0"/><link name="l1"><inertial><mass value="2"/></inertial></link><link name="l2"/>
<joint name="j1" type="revolute"><parent link="l0"/><child link="l1"/>
<origin xyz="0 0 0.3" rpy="0 0 0.1"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="1"/></joint>
<joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/>
<origin xyz="0.2 0 0"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="1"/></joint>
</robot>
"""
FORGED_XML = [
    b'<!DOCTYPE a [<!ENTITY b "x"><!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;">]>',
    b'<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]>',
    b"<link>" * 5000,
    b"&b;",
    b'xyz="nan inf 1e999"',
]


@seeded(80)
@given(damaged(PRINTER))
def test_a_damaged_configuration_of_a_printer(tmp_path: Path, data: bytes) -> None:
    attempt(tmp_path / "printer.cfg", data, read_printer)


@seeded(60)
@given(damaged(ARM), st.sampled_from([b"", *FORGED_XML]))
def test_a_damaged_urdf(tmp_path: Path, data: bytes, front: bytes) -> None:
    attempt(tmp_path / "arm.urdf", front + data, robot_from_urdf)


@seeded(40)
@given(st.data())
def test_a_damaged_workbook(tmp_path: Path, data: st.DataObject) -> None:
    """Damage to the bytes of the packed file, or to a sheet that is packed correctly again."""
    book, packed = Workbook(), BytesIO()
    for line in TABLE.decode().splitlines():
        book.active.append(line.split(","))
    book.save(packed)
    content = data.draw(st.one_of(damaged(packed.getvalue()), repacked(packed.getvalue())))
    (tmp_path / "t.xlsx").write_bytes(content)
    (tmp_path / "m.yaml").write_bytes(text_of(MAPPING))
    with bounded():
        session_of_table(tmp_path / "t.xlsx", read_mapping(tmp_path / "m.yaml", SRBD), SRBD)


def repacked(packed: bytes) -> st.SearchStrategy[bytes]:
    """A workbook with one of its parts damaged."""
    with ZipFile(BytesIO(packed)) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}

    def with_part(name: str) -> st.SearchStrategy[bytes]:
        return damaged(parts[name]).map(lambda content: _packed({**parts, name: content}))

    return st.sampled_from(sorted(parts)).flatmap(with_part)


def _packed(parts: dict[str, bytes]) -> bytes:
    out = BytesIO()
    with ZipFile(out, "w", ZIP_DEFLATED) as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    return out.getvalue()
