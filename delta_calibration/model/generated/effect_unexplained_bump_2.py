"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 3), ('v', 1), ('c', 4)), 1, (), (), (), ('v',))
SIZE = 10
SHARED = (10, 10)


def full(w):
    i7 = w[7]
    i2 = w[2]
    i3 = w[3]
    i0 = w[0]
    i4 = w[4]
    i1 = w[1]
    i5 = w[5]
    i6 = w[6]
    t3 = 1.0 if 0.0 < i7 else 0.0
    t5 = i2 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t10 = i3 * t9
    t13 = i0 - i4
    t14 = t13 * t13
    t17 = i1 - i5
    t18 = t17 * t17
    t19 = t14 + t18
    t21 = t19 * i6
    t22 = -(t21)
    t23 = exp(t22)
    t24 = t10 * t23
    t26 = t23 * t9
    w[8] = t24
    w[9] = t26


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "376ffda714ad4501"),
}
ADDRESSES["near"] = ADDRESSES["full"]
