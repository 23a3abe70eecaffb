"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 1), ('v', 1), ('c', 1)), 1, (), (), (), ('v',))
SIZE = 5
SHARED = (5, 5)


def full(w):
    i0 = w[0]
    i2 = w[2]
    i1 = w[1]
    t3 = i0 - i2
    t4 = i1 * t3
    w[3] = t4
    w[4] = t3


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "7f57944ba2440312"),
}
ADDRESSES["near"] = ADDRESSES["full"]
