"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 2), ('v', 1), ('c', 4)), 1, (), (), (), ('v',))
SIZE = 9
SHARED = (9, 9)


def full(w):
    i0 = w[0]
    i3 = w[3]
    i2 = w[2]
    i4 = w[4]
    i1 = w[1]
    i5 = w[5]
    i6 = w[6]
    t3 = i0 - i3
    t4 = i2 * t3
    t6 = t4 * i4
    t9 = i1 - i5
    t11 = t9 * i6
    t12 = t6 * t11
    t14 = i4 * t3
    t15 = t11 * t14
    w[7] = t12
    w[8] = t15


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "a1fbe6cc4ea3148e"),
}
ADDRESSES["near"] = ADDRESSES["full"]
