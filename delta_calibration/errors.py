"""The exceptions of the package, and the exit code of each kind.

Every failure that a user can cause derives from `CalibrationError`. The message names what was
found, where, and what is allowed; the command line prints it as one line and exits with
`exit_code`.
"""


class CalibrationError(Exception):
    """Root of all failures this package raises on purpose."""

    exit_code = 1


class InputError(CalibrationError):
    """Wrong use or bad input: a file, field or value that the user has to change."""

    exit_code = 2


class ConfigError(InputError):
    """A robot or calibration file with a missing, unknown or impossible entry."""


class ContentError(ConfigError):
    """A file with wrong content; the message may quote part of it."""


class RefusedFileError(ConfigError):
    """A file that was refused; the message does not quote its content.

    Attributes:
        why: what is wrong with it, for readers who may see its content.
    """

    def __init__(self, message: str, why: str) -> None:
        super().__init__(message)
        self.why = why


class RecordingError(InputError):
    """A session that cannot be read, or lacks the requested data."""


class DataError(CalibrationError):
    """Valid input that does not suffice: too few poses, nothing at rest, no overlap in time."""


class MistakeError(DataError):
    """A session recorded with a mistake in units, wiring, clocks, frames or files."""


class ReachError(DataError):
    """A pose or joint command that the mechanism cannot reach."""


class SingularityError(DataError):
    """A pose at which the mechanism loses stiffness or mobility, so that no derivative exists."""
