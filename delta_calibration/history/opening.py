"""Opening a store where its library may be missing."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from delta_calibration.errors import InputError

if TYPE_CHECKING:  # others do not wait for a database's library
    from delta_calibration.history.store import Store


def require_library() -> None:
    """Refuse in words what needs SQLAlchemy, where that is not there.

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
    """The store, see `open_store`.

    Raises:
        InputError: no SQLAlchemy.
    """
    require_library()
    from delta_calibration.history.store import open_store

    return open_store(url, make)
