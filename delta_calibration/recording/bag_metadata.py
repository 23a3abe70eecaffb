"""`metadata.yaml` of a rosbag2 folder, version 9: read and written."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from delta_calibration.documents import parse_yaml
from delta_calibration.errors import InputError
from delta_calibration.texts import read_text

FILE_NAME = "metadata.yaml"
_ROOT = "rosbag2_bagfile_information"
_LONGEST = 4 << 20  # bytes of the file at most; with a thousand topics it has about 1 MiB
_NOTHING_NS = 2**63 - 1  # start time that rosbag2 writes if there are no messages
_FOREVER = {"sec": 9223372036, "nsec": 854775807}


@dataclass(frozen=True)
class Qos:
    """Quality-of-service profile that a publisher offered, so that a player can offer the same."""

    reliability: str = "reliable"
    durability: str = "volatile"
    depth: int = 100
    history: str = "keep_last"

    def entries(self) -> dict[str, object]:
        """The profile as version 9 writes it."""
        return {
            "history": self.history,
            "depth": self.depth,
            "reliability": self.reliability,
            "durability": self.durability,
            "deadline": dict(_FOREVER),
            "lifespan": dict(_FOREVER),
            "liveliness": "automatic",
            "liveliness_lease_duration": dict(_FOREVER),
            "avoid_ros_namespace_conventions": False,
        }


LATCHED = Qos(durability="transient_local", depth=1)


@dataclass(frozen=True)
class TopicEntry:
    """One topic as `metadata.yaml` lists it."""

    name: str
    type_name: str
    type_hash: str
    qos: tuple[Qos, ...]
    count: int


@dataclass(frozen=True)
class BagMetadata:
    """Entries of `metadata.yaml` that are needed to read a recording."""

    files: tuple[str, ...] = ()
    compression_mode: str = ""  # "", "file" or "message"; chunk compression is MCAP's own affair
    custom_data: Mapping[str, str] | None = None


def read_metadata(path: Path) -> BagMetadata | None:
    """Read `metadata.yaml`; None if it is absent, incomplete or something else.

    The data files describe their own messages, so a damaged `metadata.yaml` stops nothing.
    """
    try:
        content = parse_yaml(read_text(path, most=_LONGEST), str(path))
        information: dict[str, Any] = content[_ROOT]
        files = information.get("relative_file_paths") or ()
        custom = information.get("custom_data") or {}
        return BagMetadata(
            files=tuple(Path(str(file)).name for file in files),
            compression_mode=_no_none(information.get("compression_mode")),
            custom_data={str(key): str(value) for key, value in custom.items()},
        )
    except (InputError, KeyError, TypeError, AttributeError):
        return None


def metadata_text(
    file: str,
    topics: Sequence[TopicEntry],
    span_ns: tuple[int, int] | None,
    custom_data: Mapping[str, str],
    *,
    rooted: bool = True,
) -> str:
    """Content of `metadata.yaml`.

    Args:
        file: Name of the data file in the folder.
        topics: All topics with their counts.
        span_ns: First and last time of arrival [ns]; None if nothing has arrived.
        custom_data: Provenance.
        rooted: Include the root key; the copy inside an MCAP file omits it.
    """
    first, last = span_ns if span_ns else (_NOTHING_NS, _NOTHING_NS)
    count = sum(topic.count for topic in topics)
    extent = {
        "starting_time": {"nanoseconds_since_epoch": first},
        "duration": {"nanoseconds": last - first},
        "message_count": count,
    }
    information = {
        "version": 9,
        "storage_identifier": "mcap",
        **extent,
        "topics_with_message_count": [_topic_entry(topic) for topic in topics],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file],
        "files": [{"path": file, **_copied(extent)}],
        "custom_data": dict(custom_data) or None,
        "ros_distro": "jazzy",  # whose message definitions are in it
    }
    return dump_yaml({_ROOT: information} if rooted else information)


def dump_yaml(content: object) -> str:
    """Block-style YAML without aliases or broken lines."""
    yaml = YAML(typ="safe")
    yaml.default_flow_style = False
    yaml.width = 10_000
    stream = StringIO()
    yaml.dump(content, stream)
    return stream.getvalue()


def replace_file(path: Path, text: str, *, on_disk: bool) -> None:
    """Replace a file so that a killed writer leaves the old or the new content, never a part.

    Args:
        path: The file.
        text: Its new content.
        on_disk: Wait until the content is on the disk, so that this holds after a power failure.
    """
    temporary = path.with_name(path.name + ".tmp")
    with temporary.open("w", encoding="utf-8") as handle:
        handle.write(text)
        if on_disk:
            handle.flush()
            os.fsync(handle.fileno())
    temporary.replace(path)


def _topic_entry(topic: TopicEntry) -> dict[str, object]:
    return {
        "topic_metadata": {
            "name": topic.name,
            "type": topic.type_name,
            "serialization_format": "cdr",
            "offered_qos_profiles": [qos.entries() for qos in topic.qos],
            "type_description_hash": topic.type_hash,
        },
        "message_count": topic.count,
    }


def _copied(extent: Mapping[str, Any]) -> dict[str, object]:
    # Shared objects would come out as YAML aliases.
    return {k: dict(v) if isinstance(v, Mapping) else v for k, v in extent.items()}


def _no_none(mode: object) -> str:
    text = str(mode or "").lower()
    return "" if text == "none" else text
