"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 2), ('v', 1), ('c', 3)), 1, (), (), (), ('v',))
SIZE = 8
SHARED = (8, 8)


def full(w):
    i5 = w[5]
    i1 = w[1]
    i2 = w[2]
    i0 = w[0]
    i3 = w[3]
    i4 = w[4]
    t3 = 1.0 if 0.0 < i5 else 0.0
    t5 = i1 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t10 = i2 * t9
    t13 = i0 - i3
    t14 = t13 * t13
    t16 = t14 * i4
    t17 = -(t16)
    t18 = exp(t17)
    t19 = t10 * t18
    t21 = t18 * t9
    w[6] = t19
    w[7] = t21


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "9be720466a30c13d"),
}
ADDRESSES["near"] = ADDRESSES["full"]
