"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import sqrt

from delta_calibration.model.jit import idle, law

LAYOUT = ((('x', 3), ('g', 5), ('c', 3)), 1, ('g', 'c'), (), (), ())
SIZE = 13
SHARED = (13, 13)


def setup(w):
    i3 = w[3]
    i8 = w[8]
    i4 = w[4]
    i9 = w[9]
    i5 = w[5]
    i10 = w[10]
    t16 = i3 - i8
    t17 = t16 * t16
    t19 = i4 - i9
    t20 = t19 * t19
    t21 = t17 + t20
    t23 = i5 - i10
    t24 = t23 * t23
    t25 = t21 + t24
    t26 = sqrt(t25)
    w[12] = t26


def full(w):
    i3 = w[3]
    i0 = w[0]
    i4 = w[4]
    i1 = w[1]
    i5 = w[5]
    i2 = w[2]
    t26 = w[12]
    i7 = w[7]
    i6 = w[6]
    t2 = i3 - i0
    t3 = t2 * t2
    t6 = i4 - i1
    t7 = t6 * t6
    t8 = t3 + t7
    t11 = i5 - i2
    t12 = t11 * t11
    t13 = t8 + t12
    t14 = sqrt(t13)
    t27 = t14 - t26
    t29 = t27 - i7
    t31 = t29 / i6
    w[11] = t31


ADDRESSES = {
    "setup": law(setup, "817a30679860c7e0"),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "817a30679860c7e0"),
}
ADDRESSES["near"] = ADDRESSES["full"]
