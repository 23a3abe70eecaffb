"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('x', 3), ('o', 3)), 3, (), ('x',), (), ('x', 'o'))
SIZE = 27
SHARED = (27, 27)


def full(w):
    i0 = w[0]
    i3 = w[3]
    i1 = w[1]
    i4 = w[4]
    i2 = w[2]
    i5 = w[5]
    t2 = i0 + i3
    t6 = i1 + i4
    t10 = i2 + i5
    w[6] = t2
    w[7] = t6
    w[8] = t10
    w[9] = 1.0
    w[13] = 1.0
    w[17] = 1.0
    w[18] = 1.0
    w[22] = 1.0
    w[26] = 1.0


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "dc7c028c82cfbe60"),
}
ADDRESSES["near"] = ADDRESSES["full"]
