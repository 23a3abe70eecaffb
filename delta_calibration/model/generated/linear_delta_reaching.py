"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import cos, sin, sqrt

from delta_calibration.model.jit import idle, law

LAYOUT = ((('x', 3), ('g', 4), ('c', 0)), 1, ('g', 'c'), (), (), ())
SIZE = 11
SHARED = (11, 11)


def setup(w):
    i6 = w[6]
    i4 = w[4]
    i3 = w[3]
    t4 = i6 * i6
    w[8] = t4
    t8 = cos(i4)
    t9 = i3 * t8
    w[9] = t9
    t14 = sin(i4)
    t15 = i3 * t14
    w[10] = t15


def full(w):
    i2 = w[2]
    i5 = w[5]
    i0 = w[0]
    t9 = w[9]
    t4 = w[8]
    i1 = w[1]
    t15 = w[10]
    t2 = i2 - i5
    t10 = i0 - t9
    t11 = t10 * t10
    t12 = t4 - t11
    t16 = i1 - t15
    t17 = t16 * t16
    t18 = t12 - t17
    t19 = sqrt(t18)
    t20 = t2 + t19
    t21 = -(t20)
    w[7] = t21


ADDRESSES = {
    "setup": law(setup, "8c0f19cb5c107a21"),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "8c0f19cb5c107a21"),
}
ADDRESSES["near"] = ADDRESSES["full"]
