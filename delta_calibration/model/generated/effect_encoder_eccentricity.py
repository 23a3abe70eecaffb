"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import cos, sin

from delta_calibration.model.jit import law

LAYOUT = ((('s', 1), ('v', 2), ('c', 0)), 1, (), (), (), ('v',))
SIZE = 6
SHARED = (6, 6)


def setup(w):  # type: ignore[no-untyped-def]
    pass


def shared(w):  # type: ignore[no-untyped-def]
    pass


def near(w):  # type: ignore[no-untyped-def]
    i0 = w[0]
    i1 = w[1]
    i2 = w[2]
    t2 = sin(i0)
    t3 = i1 * t2
    t5 = cos(i0)
    t6 = i2 * t5
    t7 = t3 + t6
    w[3] = t7


def full(w):  # type: ignore[no-untyped-def]
    i0 = w[0]
    i1 = w[1]
    i2 = w[2]
    t2 = sin(i0)
    t3 = i1 * t2
    t5 = cos(i0)
    t6 = i2 * t5
    t7 = t3 + t6
    w[3] = t7
    w[4] = t2
    w[5] = t5


ADDRESSES = {
    "setup": law(setup, "68c84b5ec0430316"),
    "shared": law(shared, "68c84b5ec0430316"),
    "near": law(near, "68c84b5ec0430316"),
    "full": law(full, "68c84b5ec0430316"),
}
