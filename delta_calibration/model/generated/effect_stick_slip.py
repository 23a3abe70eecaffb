"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 2), ('v', 1), ('c', 2)), 1, (), (), (), ('v',))
SIZE = 7
SHARED = (7, 7)


def full(w):
    i2 = w[2]
    i0 = w[0]
    i4 = w[4]
    i1 = w[1]
    i3 = w[3]
    t2 = i2 * i0
    t5 = 1.0 - i4
    t8 = i1 / i3
    t9 = t8 * t8
    t10 = -(t9)
    t11 = exp(t10)
    t12 = t5 * t11
    t13 = i4 + t12
    t14 = t2 * t13
    t15 = -(t14)
    t17 = t13 * i0
    t18 = -(t17)
    w[5] = t15
    w[6] = t18


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "e6dfe9ad3144a8cf"),
}
ADDRESSES["near"] = ADDRESSES["full"]
