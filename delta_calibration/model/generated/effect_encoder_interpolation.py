"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import cos, sin

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 1), ('v', 2), ('c', 1)), 1, (), (), (), ('v',))
SIZE = 7
SHARED = (7, 7)


def full(w):
    i3 = w[3]
    i0 = w[0]
    i1 = w[1]
    i2 = w[2]
    t3 = i3 * i0
    t4 = sin(t3)
    t5 = i1 * t4
    t7 = cos(t3)
    t8 = i2 * t7
    t9 = t5 + t8
    w[4] = t9
    w[5] = t4
    w[6] = t7


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "ea547bcfeefde32b"),
}
ADDRESSES["near"] = ADDRESSES["full"]
