"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import cos, sin, sqrt

from delta_calibration.model.jit import idle, law

LAYOUT = ((('x', 4), ('g', 7), ('c', 2)), 1, ('g', 'c'), (), (), ())
SIZE = 15
SHARED = (15, 15)


def setup(w):
    i10 = w[10]
    t24 = i10 * i10
    w[14] = t24


def full(w):
    i2 = w[2]
    i5 = w[5]
    i11 = w[11]
    i3 = w[3]
    i4 = w[4]
    i6 = w[6]
    i1 = w[1]
    i9 = w[9]
    i7 = w[7]
    t24 = w[14]
    i0 = w[0]
    i8 = w[8]
    i12 = w[12]
    t1 = sin(i2)
    t3 = t1 * i5
    t4 = cos(i2)
    t7 = i11 * i3
    t8 = sin(t7)
    t9 = t4 * t8
    t11 = t9 * i4
    t12 = t3 - t11
    t13 = cos(t7)
    t14 = t4 * t13
    t16 = t14 * i6
    t17 = t12 + t16
    t19 = t17 + i1
    t21 = t19 - i9
    t25 = t13 * i4
    t26 = t8 * i6
    t27 = t25 + t26
    t29 = t27 - i7
    t30 = t29 * t29
    t31 = t24 - t30
    t32 = t1 * t8
    t33 = t32 * i4
    t34 = t4 * i5
    t35 = t33 + t34
    t36 = t1 * t13
    t37 = t36 * i6
    t38 = t35 - t37
    t40 = t38 + i0
    t42 = t40 - i8
    t43 = t42 * t42
    t44 = t31 - t43
    t45 = sqrt(t44)
    t46 = i12 * t45
    t47 = t21 + t46
    w[13] = t47


ADDRESSES = {
    "setup": law(setup, "edd81d78431bb4c5"),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "edd81d78431bb4c5"),
}
ADDRESSES["near"] = ADDRESSES["full"]
