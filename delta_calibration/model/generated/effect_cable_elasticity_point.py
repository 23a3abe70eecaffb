"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import sqrt

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 10), ('v', 1), ('c', 7)), 1, (), (), (), ('v',))
SIZE = 20
SHARED = (20, 20)


def full(w):
    i3 = w[3]
    i6 = w[6]
    i4 = w[4]
    i7 = w[7]
    i5 = w[5]
    i8 = w[8]
    i1 = w[1]
    i15 = w[15]
    i16 = w[16]
    i17 = w[17]
    i2 = w[2]
    i10 = w[10]
    i13 = w[13]
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
    t20 = i15 - i6
    t21 = t20 * t20
    t23 = i16 - i7
    t24 = t23 * t23
    t25 = t21 + t24
    t27 = i17 - i8
    t28 = t27 * t27
    t29 = t25 + t28
    t30 = sqrt(t29)
    t31 = i2 * t30
    t32 = t17 - t31
    t33 = i10 * t32
    t36 = i13 * i9
    t37 = t33 / t36
    t39 = t32 / t36
    w[18] = t37
    w[19] = t39


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "ac5af501efe27602"),
}
ADDRESSES["near"] = ADDRESSES["full"]
