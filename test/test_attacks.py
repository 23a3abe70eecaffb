"""Attacks on a cell by a peer on the network or by a foreign file, as they were once possible."""

from __future__ import annotations

import io
import os
import resource
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import zstandard

from delta_calibration.calibration_file import load_calibration
from delta_calibration.documents import parse_yaml, write_document
from delta_calibration.errors import InputError
from delta_calibration.plans.target_file import read_rows
from delta_calibration.recording import inspect_session, read_session
from delta_calibration.recording.klipper import read_printer
from delta_calibration.recording.table_mapping import read_mapping
from delta_calibration.robot import load_robot
from recording_helpers import both, foreign_mcap

SRBD = load_robot("srbd")
SECRET = "root_password_hash"
GIGABYTE = 1 << 30

READERS: dict[str, Callable[[Path], Any]] = {
    "robot": load_robot,
    "calibration": lambda path: load_calibration(path, SRBD),
    "mapping": lambda path: read_mapping(path, SRBD),
    "targets": lambda path: read_rows(path, SRBD),
    "bag": read_session,
    "index of a bag": inspect_session,
    "printer": read_printer,
}


@pytest.mark.timeout(20)
@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("what", ["pipe", "device"])
def test_pipes_and_devices_are_refused(tmp_path: Path, reader: str, what: str) -> None:
    path = tmp_path / ("a.mcap" if "bag" in reader else "a.yaml")
    if what == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to("/dev/full")  # endless, like /dev/zero
    with pytest.raises(InputError, match=rf"{path.name}.* regular file"):
        READERS[reader](path)


def peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def bomb(size: int) -> bytes:
    """Zeros compressed to a thirty-thousandth, made without holding them in memory."""
    out, block = io.BytesIO(), bytes(1 << 20)
    with zstandard.ZstdCompressor().stream_writer(out, closefd=False) as writer:
        for _ in range(size >> 20):
            writer.write(block)
    return out.getvalue()


def test_a_file_that_unpacks_to_gigabytes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bag.mcap.zstd"
    path.write_bytes(bomb(4 * GIGABYTE))
    assert path.stat().st_size < 500_000
    before = peak()
    with pytest.raises(InputError):
        read_session(path)
    assert peak() - before < GIGABYTE


@pytest.mark.parametrize(
    ("declared", "said"),
    [(4 * GIGABYTE, "no chunk has more"), (1000, "unpacks to more than 1000")],
)
def test_a_chunk_that_unpacks_to_gigabytes_is_not_unpacked(
    tmp_path: Path, declared: int, said: str
) -> None:
    """For any declared size; the intact data around it is still read."""
    path = foreign_mcap(tmp_path / "bag.mcap", both(20), chunk_size=1 << 20)
    records = bomb(4 * GIGABYTE)
    head = struct.pack("<QQQI", 0, 0, declared, 0)
    body = head + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(records)) + records
    chunk = b"\x06" + struct.pack("<Q", len(body)) + body
    data = path.read_bytes()
    behind = 8 + 9 + struct.unpack_from("<Q", data, 9)[0]  # after magic and header
    path.write_bytes(data[:behind] + chunk + data[behind:])
    before = peak()
    session = read_session(path)
    assert peak() - before < GIGABYTE
    assert session.tracker is not None
    assert len(session.tracker.stamp_ns) == 20
    assert any(said in note for note in session.notes), session.notes


def test_aliases_that_stand_for_millions_are_refused() -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 9)]
    with pytest.raises(InputError, match="aliases"):
        parse_yaml("\n".join(lines), "bomb")


@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_what_lies_where_a_file_is_written_first_is_not_written_to(
    tmp_path: Path, kind: str
) -> None:
    """Earlier, a link there was written through, and a pipe was waited for; it stays as it is."""
    other, wanted = tmp_path / "other", tmp_path / "c.yaml"
    other.write_text(SECRET)
    beside = tmp_path / ".c.yaml.part"
    beside.symlink_to(other) if kind == "link" else os.mkfifo(beside)
    write_document(wanted, {"a": 1})
    assert other.read_text() == SECRET
    assert wanted.is_file()
    assert not wanted.is_symlink()
    assert sorted(p.name for p in tmp_path.iterdir()) == [".c.yaml.part", "c.yaml", "other"]


# --- nodes


@pytest.fixture(name="cell")
def cell_fixture(tmp_path: Path) -> Any:
    """A node whose files are in `data`, and a secret file beside it."""
    pytest.importorskip("rclpy")
    from rclpy.parameter import Parameter

    from delta_calibration.ros.calibration_node import CalibrationNode
    from ros_helpers import Bench

    (tmp_path / "data").mkdir()
    (tmp_path / "secret.yaml").write_text(f"{SECRET}: 1\n")
    bench = Bench()

    def start(**values: Any) -> Any:
        values = {"data_dir": str(tmp_path / "data"), **values}
        made = [Parameter(k, value=v) for k, v in values.items()]
        return bench.add(CalibrationNode(context=bench.context, parameter_overrides=made))

    yield bench, start, tmp_path
    bench.take_down()


def setting(node: Any, name: str, value: Any) -> Any:
    """Set a parameter like `ros2 param set`."""
    from rclpy.parameter import Parameter

    (result,) = node.set_parameters([Parameter(name, value=value)])
    return result


def call(bench: Any, name: str) -> Any:
    from std_srvs.srv import Trigger

    client = bench.node("peer").create_client(Trigger, f"/calibration_node/{name}")
    assert bench.until(client.service_is_ready)
    future = client.call_async(Trigger.Request())
    assert bench.until(future.done)
    return future.result()


@pytest.mark.ros
@pytest.mark.parametrize("name", ["calibration", "output", "table", "robot"])
@pytest.mark.parametrize("way", ["absolute", "dots", "link"])
def test_a_peer_names_no_file_outside_data_dir(cell: Any, name: str, way: str) -> None:
    _bench, start, folder = cell
    node = start()
    (folder / "data" / "link.yaml").symlink_to(folder / "secret.yaml")
    path = {
        "absolute": str(folder / "secret.yaml"),
        "dots": "../secret.yaml",
        "link": "link.yaml",
    }[way]
    result = setting(node, name, path)
    assert not result.successful
    assert "data_dir" in result.reason
    assert not setting(node, "data_dir", "/").successful


@pytest.mark.ros
@pytest.mark.parametrize("text", ["~nobody_of_that_name/c.yaml", "loop", "c" * 5000, "a\0b"])
def test_a_text_that_is_no_path_is_refused_and_ends_no_node(cell: Any, text: str) -> None:
    """Earlier, the first of these texts, set by a peer, ended the drives' process."""
    _bench, start, folder = cell
    node = start()
    (folder / "data" / "loop").symlink_to("loop")
    result = setting(node, "calibration", text)
    assert not result.successful
    assert "not a valid path" in result.reason
    assert setting(node, "calibration", "c.yaml").successful


@pytest.mark.ros
@pytest.mark.parametrize("services", [True, False])
@pytest.mark.parametrize("together", [True, False])
def test_a_parameter_of_a_type_that_there_is_not_ends_no_node(
    cell: Any, services: bool, together: bool
) -> None:
    """Earlier, any peer could raise an exception in the spin and end the drives' process."""
    from rcl_interfaces.msg import Parameter, ParameterValue
    from rcl_interfaces.srv import SetParameters, SetParametersAtomically

    bench, start, _folder = cell
    start(services=services)
    kind, end = (SetParametersAtomically, "_atomically") if together else (SetParameters, "")
    client = bench.node("peer").create_client(kind, f"/calibration_node/set_parameters{end}")
    assert bench.until(client.service_is_ready)
    wrong = Parameter(name="ramp_s", value=ParameterValue(type=200))
    future = client.call_async(kind.Request(parameters=[wrong]))
    assert bench.until(future.done)
    answer = future.result()
    results = [answer.result] if together else answer.results
    assert [result.successful for result in results] == [False]
    assert "200" in results[0].reason


@pytest.mark.ros
def test_an_answer_tells_nothing_of_a_refused_file(cell: Any) -> None:
    bench, start, folder = cell
    (folder / "data" / "c.yaml").write_text(f"{SECRET}: 1\n")
    node = start()
    node.trigger_configure()
    assert setting(node, "calibration", "c.yaml").successful
    answer = call(bench, "reload")
    assert not answer.success
    assert answer.message
    assert SECRET not in answer.message


@pytest.mark.ros
def test_without_services_a_peer_changes_nothing(cell: Any) -> None:
    bench, start, _folder = cell
    node = start(services=False)
    own = node.get_name(), "/"
    offered = {n for n, _ in node.get_service_names_and_types_by_node(*own)}
    orders = ("enable", "fit", "diagnose", "save", "reload", "start_capture", "stop_capture")
    assert not offered & {f"/calibration_node/{name}" for name in orders}
    assert not setting(node, "ramp_s", 3.0).successful

    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState

    client = bench.node("peer").create_client(ChangeState, "/calibration_node/change_state")
    assert bench.until(client.service_is_ready)
    request = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_CONFIGURE))
    future = client.call_async(request)
    assert bench.until(future.done)
    assert not future.result().success
    assert node.state == "unconfigured"


def test_nothing_is_written_over_a_file_of_somebody_else(tmp_path: Path) -> None:
    from delta_calibration.calibration_file import require_ours

    foreign = tmp_path / "c.yaml"
    foreign.write_text(f"{SECRET}: 1\n")
    with pytest.raises(InputError) as refused:
        require_ours(foreign)
    assert SECRET not in str(refused.value)
    assert foreign.read_text() == f"{SECRET}: 1\n"
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError):
        require_ours(tmp_path / "pipe")
