from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from delta_calibration.errors import InputError, RecordingError
from delta_calibration.recording import Topics, read_session
from recording_helpers import (
    POINT,
    POSE,
    both,
    foreign_mcap,
    joints,
    point,
    pose,
)


@pytest.mark.parametrize("prefix", ["", "/", "/cell_3/", "/a/b/"])
def test_relative_absolute_and_namespaced_topics(tmp_path: Path, prefix: str) -> None:
    rows = [joints(k, f"{prefix}joint_states") for k in range(4)]
    rows += [pose(k, f"{prefix}tracker/pose") for k in range(4)]
    read = read_session(foreign_mcap(tmp_path / "f.mcap", rows))
    assert read.states is not None
    assert read.tracker is not None
    assert len(read.states.stamp_ns) == len(read.tracker.stamp_ns) == 4


def test_a_topic_that_only_ends_alike_is_another(tmp_path: Path) -> None:
    rows = [joints(k, "/my_joint_states") for k in range(3)] + [pose(0)]
    with pytest.raises(RecordingError, match="no joint angles"):
        read_session(foreign_mcap(tmp_path / "f.mcap", rows))


def test_two_namespaces_have_to_be_told_apart(tmp_path: Path) -> None:
    rows = [joints(k, f"/{space}/joint_states") for k in range(3) for space in "ab"]
    path = foreign_mcap(tmp_path / "f.mcap", [*rows, pose(0)])
    with pytest.raises(
        RecordingError,
        match=r"/a/joint_states and /b/joint_states all match .*--topic states=/a/joint_states",
    ):
        read_session(path)
    read = read_session(path, Topics(states="/b/joint_states"))
    assert read.states is not None


def test_the_topic_itself_goes_before_one_under_a_namespace(tmp_path: Path) -> None:
    rows = [joints(0), *(joints(k, "/other/joint_states") for k in range(5)), pose(0)]
    read = read_session(foreign_mcap(tmp_path / "f.mcap", rows))
    assert read.states is not None
    assert len(read.states.stamp_ns) == 1


def test_remapped_topics(tmp_path: Path) -> None:
    rows = [joints(0, "/motion/out"), joints(1, "/enc"), pose(0, "/laser"), pose(1, POSE)]
    options = ["command=/motion/out", "states=enc", "tracker_pose=/laser"]
    read = read_session(foreign_mcap(tmp_path / "f.mcap", rows), Topics.from_options(options))
    assert read.command is not None
    assert read.states is not None
    assert read.tracker is not None
    assert read.command.position[0, 0] == 0.0
    assert read.states.position[0, 0] == 1.0
    np.testing.assert_array_equal(read.tracker.position[:, 0], [0.0])


def test_options_are_parsed() -> None:
    assert Topics.from_options([]) == Topics()
    assert Topics.from_options(["tracker/pose=/a", "payload ="]) == Topics(
        tracker_pose="/a", payload=""
    )


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["joint_command"], "STREAM=NAME is needed"),
        (["speed=/x"], "one of command, states, tracker_pose, tracker_point, temperature, payl"),
        (["states=/x", "states=/y"], "states was already given as /x"),
    ],
)
def test_options_that_cannot_be_parsed(options: list[str], why: str) -> None:
    with pytest.raises(InputError, match=why):
        Topics.from_options(options)


def test_a_topic_asked_for_has_to_be_there(tmp_path: Path) -> None:
    path = foreign_mcap(tmp_path / "f.mcap", both(3))
    with pytest.raises(
        RecordingError,
        match=r"f\.mcap: there is no topic /t, .* recorded are /joint_states, /tracker/pose",
    ):
        read_session(path, Topics(temperature="/t"))


def test_pose_goes_before_point_and_can_be_turned_round(tmp_path: Path) -> None:
    rows = [m for k in range(3) for m in (joints(k), pose(k), point(k))]
    path = foreign_mcap(tmp_path / "f.mcap", rows)
    read = read_session(path)
    assert read.tracker is not None
    assert read.tracker.quaternion is not None
    assert read.notes == (
        "/tracker/pose is used, /tracker/point is not (--topic tracker_pose= reverses this)",
    )
    for topics in (Topics(tracker_pose=""), Topics(tracker_point=POINT)):
        read = read_session(path, topics)
        assert read.tracker is not None
        assert read.tracker.quaternion is None
        np.testing.assert_array_equal(read.tracker.position[:, 0], [0.0, -1.0, -2.0])
