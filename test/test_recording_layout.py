from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from delta_calibration.recording import layout
from delta_calibration.recording.layout import UndecodableError, decode, layout_of
from delta_calibration.recording.messages import JOINT_STATE, TEMPERATURE, encode_temperature
from recording_helpers import NAMES, START_NS, STORE, ros_joints


def by_rosbags(records: list[bytes]) -> list[tuple[int, tuple[str, ...], tuple[float, ...]]]:
    """Stamps, names and positions by an independent decoder."""
    rows = []
    for record in records:
        message: Any = STORE.deserialize_cdr(record, JOINT_STATE)
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        rows.append((stamp, tuple(message.name), tuple(message.position.tolist())))
    return rows


def ours(records: list[bytes]) -> list[tuple[int, tuple[str, ...], tuple[float, ...]]]:
    batches, broken = decode(records, JOINT_STATE)
    assert broken == 0
    rows: dict[int, tuple[int, tuple[str, ...], tuple[float, ...]]] = {}
    for batch in batches:
        for place, stamp, values in zip(
            batch.index.tolist(), batch.stamp_ns.tolist(), batch.values.tolist(), strict=True
        ):
            rows[place] = (stamp, batch.names, tuple(values))
    assert sorted(rows) == list(range(len(records)))
    return [rows[k] for k in range(len(records))]


def regular(rng: np.random.Generator, n: int) -> list[bytes]:
    return [ros_joints(START_NS + k, NAMES, rng.normal(size=3)) for k in range(n)]


def test_one_layout_is_one_batch_and_equals_rosbags() -> None:
    records = regular(np.random.default_rng(1), 50)
    assert ours(records) == by_rosbags(records)
    batches, _ = decode(records, JOINT_STATE)
    assert len(batches) == 1


def test_one_slice_and_one_by_one_give_identical_arrays(monkeypatch: pytest.MonkeyPatch) -> None:
    records = regular(np.random.default_rng(2), 50)
    sliced = ours(records)
    monkeypatch.setattr(layout, "_LAYOUTS_AT_ONCE", 0)
    batches, _ = decode(records, JOINT_STATE)
    assert len(batches) == 50
    assert ours(records) == sliced


def irregular(rng: np.random.Generator) -> dict[str, list[bytes]]:
    def orders(k: int) -> NDArray[np.str_]:
        return rng.permutation(NAMES)

    return {
        "order of names": [
            ros_joints(START_NS + k, orders(k), rng.normal(size=3)) for k in range(60)
        ],
        "velocity array": [
            ros_joints(START_NS + k, NAMES, rng.normal(size=3), rng.normal(size=k % 4))
            for k in range(60)
        ],
        "a frame of its own each": [
            ros_joints(START_NS + k, NAMES, rng.normal(size=3), frame=f"f{k:03d}")
            for k in range(60)
        ],
        "byte order": [
            ros_joints(START_NS + k, NAMES, rng.normal(size=3), little_endian=bool(k % 2))
            for k in range(60)
        ],
        # Array lengths are exchanged, so that two records have the same size and different
        # layouts.
        "same size, other split": [
            ros_joints(START_NS + k, NAMES, rng.normal(size=3), rng.normal(size=1))
            if k % 2
            else ros_joints(START_NS + k, ("a", "b", "c", "d")[: k % 5], rng.normal(size=k % 5))
            for k in range(60)
        ],
    }


@pytest.mark.parametrize("case", irregular(np.random.default_rng(3)))
def test_irregular_records_equal_rosbags(case: str) -> None:
    records = irregular(np.random.default_rng(3))[case]
    assert ours(records) == by_rosbags(records)
    batches, _ = decode(records, JOINT_STATE)
    assert len(batches) > 1


def test_same_size_but_other_array_lengths_are_not_taken_for_the_same() -> None:
    # Three positions and one velocity are as long as one position and three velocities.
    first = ros_joints(START_NS, NAMES, [1.0, 2.0, 3.0], [9.0])
    second = ros_joints(START_NS, NAMES, [1.0], [9.0, 8.0, 7.0])
    assert len(first) == len(second)
    assert ours([first, second, first]) == by_rosbags([first, second, first])


def test_options_of_the_encapsulation_and_padding_do_not_matter() -> None:
    plain = encode_temperature(START_NS, "ab", 21.0)
    marked = bytearray(plain)
    marked[2:4] = b"\x00\x03"  # Fast DDS counts padding bytes here
    head = layout_of(plain, TEMPERATURE).first
    marked[head - 1] = 0x5A  # uninitialised padding before the number
    batches, broken = decode([plain, bytes(marked)], TEMPERATURE)
    assert broken == 0
    assert len(batches) == 1
    np.testing.assert_array_equal(batches[0].values[:, 0], [21.0, 21.0])


def test_eight_bytes_too_many_are_borne() -> None:
    # rclpy's serialize_message can append these; rosbags refuses such a record.
    record = ros_joints(START_NS, NAMES, [1.0, 2.0, 3.0])
    assert ours([record + bytes(8)]) == by_rosbags([record])


@pytest.mark.parametrize(
    ("record", "why"),
    [
        (b"", "not plain CDR"),
        (b"\x00", "not plain CDR"),
        (b"\x00\x07\x00\x00" + bytes(60), "not plain CDR"),
        (b"\x00\x01\x00\x00" + bytes(6), "within a field"),
        (b"\x00\x01\x00\x00" + bytes(8) + struct.pack("<I", 2**31), "a length of"),
        (b"\x00\x01\x00\x00" + bytes(8) + b"\x02\x00\x00\x00\xff\x00" + bytes(30), "UTF-8"),
    ],
)
def test_what_is_no_message_is_said(record: bytes, why: str) -> None:
    with pytest.raises(UndecodableError, match=why):
        layout_of(record, JOINT_STATE)


def test_broken_records_are_counted_and_the_others_decoded() -> None:
    good = regular(np.random.default_rng(4), 6)
    bad = bytearray(good[0])
    bad[12:16] = struct.pack("<I", 4_000_000)  # length of the frame
    batches, broken = decode([bytes(bad), *good, b"", bytes(bad)], JOINT_STATE)
    assert broken == 3
    np.testing.assert_array_equal(batches[0].index, np.arange(1, 7))


@pytest.mark.parametrize("cut", range(0, 100, 3))
def test_every_cut_of_a_record_is_undecodable_or_keeps_its_positions(cut: int) -> None:
    record = ros_joints(START_NS, NAMES, [1.0, 2.0, 3.0])
    batches, broken = decode([record[:cut]], JOINT_STATE)
    assert (broken, len(batches)) == (1, 0)
