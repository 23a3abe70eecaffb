"""Properties that are computed once for each object, by any number of threads."""

from __future__ import annotations

import functools
from typing import Any, TypeVar, overload

_Result = TypeVar("_Result")
_UNKNOWN = object()


class cached_property(functools.cached_property[_Result]):  # noqa: N801 - stands in for the same
    """`functools.cached_property` without the lock that it has before Python 3.12.

    That lock is one for all objects of a class: threads with an object each would wait for one
    another. Without it, threads that ask for the same value at the same time may each compute it;
    all get the one that was stored first.
    """

    @overload
    def __get__(
        self, instance: None, owner: type[Any] | None = None
    ) -> cached_property[_Result]: ...

    @overload
    def __get__(self, instance: object, owner: type[Any] | None = None) -> _Result: ...

    def __get__(self, instance: object | None, owner: type[Any] | None = None) -> Any:
        """The value of this object, computed if it is not known yet."""
        if instance is None:
            return self
        known, name = vars(instance), str(self.attrname)
        found = known.get(name, _UNKNOWN)
        return known.setdefault(name, self.func(instance)) if found is _UNKNOWN else found
