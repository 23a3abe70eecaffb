"""Cache for results as large as a session, which can be released when no longer needed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar, cast

_Result = TypeVar("_Result")
_UNKNOWN = object()


@dataclass
class Memo:
    """Cache of results by name, each kept until it is released.

    A frozen record that holds a cache behaves the same whether the cache is filled or empty. As a
    field with `init=False` it is empty in every copy that `dataclasses.replace` makes. Threads
    that ask at the same time may each compute the result; they get equal values.
    """

    known: dict[str, Any] = field(default_factory=dict)

    def __contains__(self, name: str) -> bool:
        return name in self.known

    def of(self, name: str, compute: Callable[[], _Result]) -> _Result:
        """A result, computed now if it is not in the cache."""
        found = self.known.get(name, _UNKNOWN)
        if found is _UNKNOWN:
            found = self.known[name] = compute()
        return cast(_Result, found)

    def forget(self, *names: str) -> None:
        """Release results; they are computed again when asked for."""
        for name in names:
            self.known.pop(name, None)
