"""What can go wrong, and which exit code each kind of failure carries.

Everything that a user can cause derives from `CalibrationError`. The message names what was found,
where, and what is allowed; the command line prints it as one line and leaves with `exit_code`.
"""


class CalibrationError(Exception):
    """Root of all failures this package raises on purpose."""

    exit_code = 1


class InputError(CalibrationError):
    """Wrong use or bad input: a file, field or value that has to be changed by the user."""

    exit_code = 2


class ConfigError(InputError):
    """A robot or calibration file with a missing, unknown or impossible entry."""


class ContentError(ConfigError):
    """A file whose content is not what it should be; the message may tell some of it."""


class RefusedFileError(ConfigError):
    """A file that was refused, told without what is in it.

    Attributes:
        why: what is wrong with it, for who may read it.
    """

    def __init__(self, message: str, why: str) -> None:
        super().__init__(message)
        self.why = why


class RecordingError(InputError):
    """A session that cannot be read, or lacks what was asked of it."""


class DataError(CalibrationError):
    """Sound input without the answer: too few poses, nothing still, no overlap in time."""


class MistakeError(DataError):
    """A session that was recorded with a mistake: of units, wiring, clocks, frames or files."""


class ReachError(DataError):
    """A pose or joint command that the mechanism cannot take."""


class SingularityError(DataError):
    """A pose at which the mechanism loses stiffness or mobility, so that no derivative exists."""
