"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 2), ('v', 1), ('c', 0)), 1, (), (), (), ('v',))
SIZE = 5
SHARED = (5, 5)


def full(w):
    i0 = w[0]
    i1 = w[1]
    i2 = w[2]
    t3 = i0 + i1
    t4 = i2 * t3
    t5 = -(t4)
    t7 = -(t3)
    w[3] = t5
    w[4] = t7


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "7bfdcd7b4cf3389b"),
}
ADDRESSES["near"] = ADDRESSES["full"]
