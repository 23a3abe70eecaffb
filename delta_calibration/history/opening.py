"""Open a store, or explain that SQLAlchemy is not installed."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from delta_calibration.errors import InputError

if TYPE_CHECKING:  # so that other commands need not import the database library
    from delta_calibration.history.store import Store


def require_library() -> None:
    """Raise a clear error if SQLAlchemy is not installed.

    Raises:
        InputError: no SQLAlchemy.
    """
    try:
        import delta_calibration.history.store  # noqa: F401
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != "sqlalchemy":
            raise
        raise InputError(
            "a history needs SQLAlchemy: pip install 'delta_calibration[history]'"
        ) from error


def opened(url: str, make: bool = False) -> AbstractContextManager[Store]:
    """Open a store, see `open_store`.

    Raises:
        InputError: no SQLAlchemy.
    """
    require_library()
    from delta_calibration.history.store import open_store

    return open_store(url, make)
