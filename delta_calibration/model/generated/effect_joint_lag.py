"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 2), ('v', 1), ('c', 1)), 1, (), (), (), ('v',))
SIZE = 6
SHARED = (6, 6)


def full(w):
    i3 = w[3]
    i1 = w[1]
    i0 = w[0]
    i2 = w[2]
    t3 = i3 * i1
    t5 = t3 - i0
    t6 = i2 * t5
    w[4] = t6
    w[5] = t5


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "b413c07597837ae0"),
}
ADDRESSES["near"] = ADDRESSES["full"]
