"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import cos, sin, sqrt

from delta_calibration.model.jit import idle, law

LAYOUT = ((('x', 3), ('g', 6), ('c', 0)), 1, ('g', 'c'), (), (), ())
SIZE = 16
SHARED = (16, 16)


def setup(w):
    i4 = w[4]
    i3 = w[3]
    i7 = w[7]
    i8 = w[8]
    i6 = w[6]
    t3 = cos(i4)
    t4 = i3 * t3
    w[10] = t4
    t7 = t3 * i7
    t8 = sin(i4)
    t10 = t8 * i8
    t11 = t7 - t10
    t13 = i7 * i7
    t14 = 1.0 + t13
    t15 = i8 * i8
    t16 = t14 + t15
    t17 = sqrt(t16)
    w[11] = t17
    t18 = t11 / t17
    w[12] = t18
    t21 = i3 * t8
    w[13] = t21
    t23 = t8 * i7
    t24 = t3 * i8
    t25 = t23 + t24
    t26 = t25 / t17
    w[14] = t26
    t42 = i6 * i6
    w[15] = t42


def full(w):
    i0 = w[0]
    t4 = w[10]
    t18 = w[12]
    i1 = w[1]
    t21 = w[13]
    t26 = w[14]
    i2 = w[2]
    i5 = w[5]
    t17 = w[11]
    t42 = w[15]
    t5 = i0 - t4
    t19 = t5 * t18
    t22 = i1 - t21
    t27 = t22 * t26
    t28 = t19 + t27
    t31 = i2 - i5
    t32 = t31 / t17
    t33 = t28 + t32
    t34 = t33 * t33
    t35 = t5 * t5
    t36 = t22 * t22
    t37 = t35 + t36
    t38 = t31 * t31
    t39 = t37 + t38
    t40 = t34 - t39
    t43 = t40 + t42
    t44 = sqrt(t43)
    t45 = t33 + t44
    t46 = -(t45)
    w[9] = t46


ADDRESSES = {
    "setup": law(setup, "f701982757bde0c2"),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "f701982757bde0c2"),
}
ADDRESSES["near"] = ADDRESSES["full"]
