"""Settings in the joints' unit whose default value depends on the mechanism."""

from __future__ import annotations

from typing import Any, overload


class Usual:
    """Field of an effect whose default is a multiple of the mechanism's joint size.

    `speed: Usual = Usual(0.1)` is 0.1 rad/s for a Delta's joint, and the equivalent for others.
    """

    def __init__(self, of_a_delta: float) -> None:
        """Set the default for a Delta, whose joint size is 1."""
        self._of_a_delta = of_a_delta

    def __set_name__(self, owner: type, name: str) -> None:
        """Remember the field's name."""
        self._name = name

    @overload
    def __get__(self, effect: None, owner: type) -> None: ...

    @overload
    def __get__(self, effect: Any, owner: type) -> float: ...

    def __get__(self, effect: Any, owner: type) -> float | None:
        """The given value, or else the default; None on the class, as a dataclass default."""
        if effect is None:
            return None
        given: float | None = vars(effect)[self._name]
        if given is not None:
            return given
        return self._of_a_delta * float(effect.mechanism.joint_size)

    def __set__(self, effect: Any, value: float | None) -> None:
        """Store the value when the effect is created; later the frozen dataclass refuses."""
        vars(effect)[self._name] = value
