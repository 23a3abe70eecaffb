"""Sessions of machines that hide something, made without any code of the detector.

`hide({"backlash": 1.0}, seed=7)` gives a `Trial`: `session` is what a detector may see, `causes`
are what is hidden (names, locations, true values), `truth` is where the machine stands without
noise at places held out, `signal` how much the causes move the measured points.
"""

from blind.session import Hidden, Trial, Truth, hide

__all__ = ["Hidden", "Trial", "Truth", "hide"]
