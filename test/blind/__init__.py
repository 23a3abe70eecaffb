"""Sessions of machines that hide something, made without any code of the detector.

The detector knows effects as columns of a linearised chain; here a machine is six distances
between points, a play is an operator with a state, weight is energy, lag is a differential
equation. Only the streams of a session are the package's.
"""

from blind.session import Hidden, Trial, hide

__all__ = ["Hidden", "Trial", "hide"]
