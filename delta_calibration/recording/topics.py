"""Names of the topics that hold the streams of a recording."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace

from delta_calibration.errors import InputError, RecordingError


@dataclass(frozen=True)
class Topics:
    """Names of the topics to read.

    A name without a leading slash is also found under a namespace, if only one topic ends with it;
    a name with a leading slash is not searched in namespaces. An empty name omits the stream.
    """

    command: str = "joint_command"
    states: str = "joint_states"
    tracker_pose: str = "tracker/pose"
    tracker_point: str = "tracker/point"
    temperature: str = "cell/temperature"
    payload: str = "cell/payload"

    @classmethod
    def from_options(cls, options: Iterable[str]) -> Topics:
        """Topics from the values of `--topic STREAM=NAME`, such as `command=/my/joint_command`.

        Raises:
            InputError: Not of that form, an unknown stream, or a stream given twice.
        """
        given: dict[str, str] = {}
        for option in options:
            stream, equals, name = (part.strip() for part in option.partition("="))
            stream = stream.replace("-", "_").replace("/", "_")
            if not equals or stream not in _STREAMS:
                raise InputError(
                    f"--topic {option}: STREAM=NAME is needed, with STREAM one of"
                    f" {', '.join(_STREAMS)}"
                )
            if stream in given:
                raise InputError(
                    f"--topic {option}: {stream} was already given as {given[stream]}"
                )
            given[stream] = name
        return replace(cls(), **given)

    def find(self, stream: str, names: Iterable[str]) -> str | None:
        """Find the topic of a stream among the recorded topics `names`.

        Returns:
            Its name, or None if it is not recorded or was left out by an empty name.

        Raises:
            RecordingError: Several topics match, or a name given by the user is not recorded.
        """
        wanted: str = getattr(self, stream)
        if not wanted:
            return None
        names = set(names)
        if wanted in names:
            return wanted
        bare = wanted.strip("/")
        found = sorted(name for name in names if name.strip("/") == bare)
        if not found and not wanted.startswith("/"):
            found = sorted(name for name in names if name.endswith(f"/{bare}"))
        if len(found) > 1:
            raise RecordingError(
                f"{' and '.join(found)} all match {wanted}: choose one with --topic "
                f"{stream}={found[0]}"
            )
        if not found and wanted != getattr(DEFAULT_TOPICS, stream):
            raise RecordingError(
                f"there is no topic {wanted}, asked for by --topic {stream}={wanted};"
                f" recorded are {listing(names)}"
            )
        return found[0] if found else None


_STREAMS = tuple(field.name for field in fields(Topics))
DEFAULT_TOPICS = Topics()


def listing(names: Iterable[str]) -> str:
    """Distinct names, sorted and separated by commas, or `none`."""
    return ", ".join(sorted(set(names))) or "none"
