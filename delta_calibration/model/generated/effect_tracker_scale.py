"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 3), ('v', 1), ('c', 0)), 3, (), (), (), ('v',))
SIZE = 10
SHARED = (10, 10)


def full(w):
    i3 = w[3]
    i0 = w[0]
    i1 = w[1]
    i2 = w[2]
    t2 = i3 * i0
    t5 = i3 * i1
    t8 = i3 * i2
    w[4] = t2
    w[5] = t5
    w[6] = t8
    w[7] = i0
    w[8] = i1
    w[9] = i2


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "c7627cf24fa58871"),
}
ADDRESSES["near"] = ADDRESSES["full"]
