"""The folder that files named by parameters lie in, and who may name which.

Any peer on the network can set a parameter of a node and call its services; only who started the
node can say where it may read and write. Files that parameters name later lie under `data_dir`,
the node's working folder where it is not given, links followed. A file that was named at the start
and lies elsewhere may be named again, unless `data_dir` was given: then all lie under it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from delta_calibration.errors import InputError
from delta_calibration.texts import bounded


@dataclass(frozen=True)
class DataFolder:
    """What a node may read and write.

    Attributes:
        folder: links resolved.
        given: whether who started the node named it.
        known: texts that were values at the start, and may be named again.
    """

    folder: Path
    given: bool
    known: frozenset[str] = frozenset()

    @classmethod
    def of(cls, text: str) -> DataFolder:
        """The folder that a parameter names; the working folder where it is empty.

        Raises:
            InputError: no such folder.
        """
        folder = _resolved("data_dir", Path.cwd(), text)
        if not folder.is_dir():
            raise InputError(f"parameter data_dir: {text!r} is no folder")
        return cls(folder, bool(text))

    def path(self, name: str, text: str) -> Path:
        """The file that the text of a parameter means; a relative one lies in the folder.

        Raises:
            InputError: it lies elsewhere, or is no path.
        """
        resolved = _resolved(name, self.folder, text)
        if text in self.known and not self.given:
            return self.folder / Path(text).expanduser()
        if not resolved.is_relative_to(self.folder):
            raise InputError(f"parameter {name}: {text!r} lies outside data_dir, {self.folder}")
        return resolved


def _resolved(name: str, folder: Path, text: str) -> Path:
    """What a text means from a folder on, links followed.

    Raises:
        InputError: nothing: a home of nobody, links in a circle, a zero byte, a name too long.
    """
    try:
        file = (folder / Path(text).expanduser()).resolve()
        file.exists()
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(f"parameter {name}: {bounded(text)!r} is no path: {error}") from error
    return file
