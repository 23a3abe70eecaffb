"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 6), ('v', 1), ('c', 1)), 3, (), (), (), ('v',))
SIZE = 14
SHARED = (14, 14)


def full(w):
    i7 = w[7]
    i3 = w[3]
    i0 = w[0]
    i6 = w[6]
    i4 = w[4]
    i1 = w[1]
    i5 = w[5]
    i2 = w[2]
    t3 = i7 * i3
    t5 = t3 - i0
    t6 = i6 * t5
    t9 = i7 * i4
    t11 = t9 - i1
    t12 = i6 * t11
    t15 = i7 * i5
    t17 = t15 - i2
    t18 = i6 * t17
    w[8] = t6
    w[9] = t12
    w[10] = t18
    w[11] = t5
    w[12] = t11
    w[13] = t17


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "bf715913fd7c9116"),
}
ADDRESSES["near"] = ADDRESSES["full"]
