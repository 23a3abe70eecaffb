"""Settings in the joints' unit, whose usual value is known once the mechanism is."""

from __future__ import annotations

from typing import Any, overload


class Usual:
    """A field of an effect that is so many times the mechanism's joint size, if not given.

    `speed: Usual = Usual(0.1)` is 0.1 rad/s of a Delta's joint, and what does as much of others.
    """

    def __init__(self, of_a_delta: float) -> None:
        """With the value on a Delta, whose joint size is 1."""
        self._of_a_delta = of_a_delta

    def __set_name__(self, owner: type, name: str) -> None:
        """Remember what it is called."""
        self._name = name

    @overload
    def __get__(self, effect: None, owner: type) -> None: ...

    @overload
    def __get__(self, effect: Any, owner: type) -> float: ...

    def __get__(self, effect: Any, owner: type) -> float | None:
        """The value that was given, or the usual one; None of the class, as a field's default."""
        if effect is None:
            return None
        given: float | None = vars(effect)[self._name]
        if given is not None:
            return given
        return self._of_a_delta * float(effect.mechanism.joint_size)

    def __set__(self, effect: Any, value: float | None) -> None:
        """Keep what is given when the effect is made; later, frozen, it refuses."""
        vars(effect)[self._name] = value
