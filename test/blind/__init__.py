"""Sessions of machines with something hidden, made without any code of the detector.

`hide({"backlash": 1.0}, seed=7)` returns a `Trial`: `session` is what a detector may use, `causes`
are the hidden causes (names, locations, true values), `truth` contains noise-free positions at
held-out places, and `signal` is the size by which the causes move the measured points.
"""

from blind.session import Hidden, Trial, Truth, hide

__all__ = ["Hidden", "Trial", "Truth", "hide"]
