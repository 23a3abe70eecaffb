"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import cos, sin

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 1), ('v', 2), ('c', 0)), 1, (), (), (), ('v',))
SIZE = 6
SHARED = (6, 6)


def full(w):
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
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "9be35d4a28a867de"),
}
ADDRESSES["near"] = ADDRESSES["full"]
