"""Recordings of a cell: rosbag2 sessions to streams and back. Needs no ROS."""

from delta_calibration.recording.bag_metadata import LATCHED, Qos
from delta_calibration.recording.info import SessionInfo, TopicInfo, inspect_session, joints_in
from delta_calibration.recording.reader import RawMessage, read_messages, read_session
from delta_calibration.recording.session_file import write_session
from delta_calibration.recording.topics import DEFAULT_TOPICS, Topics
from delta_calibration.recording.writer import SessionWriter

__all__ = [
    "DEFAULT_TOPICS",
    "LATCHED",
    "Qos",
    "RawMessage",
    "SessionInfo",
    "SessionWriter",
    "TopicInfo",
    "Topics",
    "inspect_session",
    "joints_in",
    "read_messages",
    "read_session",
    "write_session",
]
