"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 4), ('v', 1), ('c', 5)), 1, (), (), (), ('v',))
SIZE = 12
SHARED = (12, 12)


def full(w):
    i9 = w[9]
    i3 = w[3]
    i4 = w[4]
    i0 = w[0]
    i5 = w[5]
    i1 = w[1]
    i6 = w[6]
    i2 = w[2]
    i7 = w[7]
    i8 = w[8]
    t3 = 1.0 if 0.0 < i9 else 0.0
    t5 = i3 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t10 = i4 * t9
    t13 = i0 - i5
    t14 = t13 * t13
    t17 = i1 - i6
    t18 = t17 * t17
    t19 = t14 + t18
    t22 = i2 - i7
    t23 = t22 * t22
    t24 = t19 + t23
    t26 = t24 * i8
    t27 = -(t26)
    t28 = exp(t27)
    t29 = t10 * t28
    t31 = t28 * t9
    w[10] = t29
    w[11] = t31


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "f662314265d203ee"),
}
ADDRESSES["near"] = ADDRESSES["full"]
