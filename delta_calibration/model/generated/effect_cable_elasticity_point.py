"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import sqrt

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 10), ('v', 1), ('c', 5)), 1, (), (), (), ('v',))
SIZE = 18
SHARED = (18, 18)


def full(w):
    i3 = w[3]
    i6 = w[6]
    i4 = w[4]
    i7 = w[7]
    i5 = w[5]
    i8 = w[8]
    i1 = w[1]
    i13 = w[13]
    i14 = w[14]
    i15 = w[15]
    i2 = w[2]
    i10 = w[10]
    i9 = w[9]
    t4 = i3 - i6
    t5 = t4 * t4
    t8 = i4 - i7
    t9 = t8 * t8
    t10 = t5 + t9
    t13 = i5 - i8
    t14 = t13 * t13
    t15 = t10 + t14
    t16 = sqrt(t15)
    t17 = i1 * t16
    t20 = i13 - i6
    t21 = t20 * t20
    t23 = i14 - i7
    t24 = t23 * t23
    t25 = t21 + t24
    t27 = i15 - i8
    t28 = t27 * t27
    t29 = t25 + t28
    t30 = sqrt(t29)
    t31 = i2 * t30
    t32 = t17 - t31
    t33 = i10 * t32
    t35 = t33 / i9
    t37 = t32 / i9
    w[16] = t35
    w[17] = t37


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "8226ff526676cb57"),
}
ADDRESSES["near"] = ADDRESSES["full"]
