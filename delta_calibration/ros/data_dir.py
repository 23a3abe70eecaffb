"""Restriction of the files named by parameters to the folder `data_dir`.

Any peer on the network can set a parameter of a node and call its services, but only the user who
starts the node decides where it may read and write. Files that parameters name later must lie
under `data_dir` (default: the node's working folder), with links resolved. A file named at the
start that lies elsewhere may be named again, unless `data_dir` was given: then all lie under it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from delta_calibration.errors import InputError
from delta_calibration.texts import bounded


@dataclass(frozen=True)
class DataFolder:
    """Folder that a node may read and write.

    Attributes:
        folder: path with links resolved.
        given: whether it was given at the start of the node.
        known: parameter values at the start, which may be set again.
    """

    folder: Path
    given: bool
    known: frozenset[str] = frozenset()

    @classmethod
    def of(cls, text: str) -> DataFolder:
        """Folder named by a parameter; the working folder if that is empty.

        Raises:
            InputError: no such folder.
        """
        folder = _resolved("data_dir", Path.cwd(), text)
        if not folder.is_dir():
            raise InputError(f"parameter data_dir: {text!r} is not a folder")
        return cls(folder, bool(text))

    def path(self, name: str, text: str) -> Path:
        """File named by the text of a parameter; a relative path starts at the folder.

        Raises:
            InputError: it lies outside the folder, or is no path.
        """
        resolved = _resolved(name, self.folder, text)
        if text in self.known and not self.given:
            return self.folder / Path(text).expanduser()
        if not resolved.is_relative_to(self.folder):
            raise InputError(f"parameter {name}: {text!r} lies outside data_dir, {self.folder}")
        return resolved


def _resolved(name: str, folder: Path, text: str) -> Path:
    """Resolve a path relative to a folder, with links followed.

    Raises:
        InputError: unknown home folder, circular links, a zero byte, or a name that is too long.
    """
    try:
        file = (folder / Path(text).expanduser()).resolve()
        file.exists()
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(
            f"parameter {name}: {bounded(text)!r} is not a valid path: {error}"
        ) from error
    return file
