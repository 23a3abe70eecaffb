"""Which topic of a recording is which stream."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace

from delta_calibration.errors import InputError, RecordingError


@dataclass(frozen=True)
class Topics:
    """Names of the topics to read.

    A name without a leading slash is also found under a namespace, where just one topic ends so;
    one with it is taken as it stands. An empty name leaves the stream out.
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
        """Which of the recorded topics `names` is this stream.

        Returns:
            Its name, or None where it isn't there or was left out by an empty name.

        Raises:
            RecordingError: Several fit, or a name that was asked for by the user isn't there.
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
                f"{' and '.join(found)} all fit {wanted}: say which by --topic {stream}={found[0]}"
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
    """Names in a sentence."""
    return ", ".join(sorted(set(names))) or "none"
