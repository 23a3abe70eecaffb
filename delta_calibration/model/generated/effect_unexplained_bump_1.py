"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 2), ('v', 1), ('c', 6)), 1, (), (), (), ('v',))
SIZE = 11
SHARED = (11, 11)


def full(w):
    i5 = w[5]
    i1 = w[1]
    i2 = w[2]
    i0 = w[0]
    i3 = w[3]
    i4 = w[4]
    i6 = w[6]
    i7 = w[7]
    i8 = w[8]
    t3 = 1.0 if 0.0 < i5 else 0.0
    t5 = i1 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t10 = i2 * t9
    t13 = i0 - i3
    t14 = t13 * t13
    t16 = t14 * i4
    t18 = i6 - i0
    t20 = i0 - i7
    t21 = max(t18, t20)
    t22 = max(t21, 0.0)
    t24 = t22 * i8
    t25 = t24 * t24
    t26 = t16 + t25
    t27 = -(t26)
    t28 = exp(t27)
    t29 = t10 * t28
    t31 = t28 * t9
    w[9] = t29
    w[10] = t31


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "690a895258a7330d"),
}
ADDRESSES["near"] = ADDRESSES["full"]
