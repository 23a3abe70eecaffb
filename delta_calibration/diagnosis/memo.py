"""Results as large as a session, computed once and let go of when they are of no more use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar, cast

_Result = TypeVar("_Result")
_UNKNOWN = object()


@dataclass
class Memo:
    """Results by name, until they are let go of.

    A frozen record that has one says the same with and without them. As a field that is not given
    (`init=False`) it is empty in every copy that `dataclasses.replace` makes. Threads that ask at
    the same time may each compute a result, which is the same.
    """

    known: dict[str, Any] = field(default_factory=dict)

    def __contains__(self, name: str) -> bool:
        return name in self.known

    def of(self, name: str, compute: Callable[[], _Result]) -> _Result:
        """A result, computed now if it is not known."""
        found = self.known.get(name, _UNKNOWN)
        if found is _UNKNOWN:
            found = self.known[name] = compute()
        return cast(_Result, found)

    def forget(self, *names: str) -> None:
        """Let go of results, which are computed anew when asked for."""
        for name in names:
            self.known.pop(name, None)
