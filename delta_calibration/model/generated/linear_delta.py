"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import cos, sin

from delta_calibration.model.jit import idle, law

LAYOUT = ((('q', 1), ('x', 3), ('g', 4), ('c', 0)), 1, ('g', 'c'), ('x',), ('x', 'q'), ('g',))
SIZE = 23
SHARED = (23, 23)


def setup(w):
    i5 = w[5]
    i4 = w[4]
    i7 = w[7]
    t3 = cos(i5)
    w[17] = t3
    t4 = i4 * t3
    w[18] = t4
    t8 = sin(i5)
    w[19] = t8
    t9 = i4 * t8
    w[20] = t9
    t21 = i7 * i7
    w[21] = t21
    t42 = 2.0 * i7
    t43 = -(t42)
    w[22] = t43


def near(w):
    i1 = w[1]
    t4 = w[18]
    i2 = w[2]
    t9 = w[20]
    i6 = w[6]
    i0 = w[0]
    i3 = w[3]
    t21 = w[21]
    t5 = i1 - t4
    t6 = t5 * t5
    t10 = i2 - t9
    t11 = t10 * t10
    t12 = t6 + t11
    t16 = i6 - i0
    t17 = i3 - t16
    t18 = t17 * t17
    t19 = t12 + t18
    t22 = t19 - t21
    t24 = 2.0 * t5
    t26 = 2.0 * t10
    t28 = 2.0 * t17
    w[8] = t22
    w[9] = t24
    w[10] = t26
    w[11] = t28
    w[12] = t28


def full(w):
    i1 = w[1]
    t4 = w[18]
    i2 = w[2]
    t9 = w[20]
    i6 = w[6]
    i0 = w[0]
    i3 = w[3]
    t21 = w[21]
    t3 = w[17]
    t8 = w[19]
    t43 = w[22]
    t5 = i1 - t4
    t6 = t5 * t5
    t10 = i2 - t9
    t11 = t10 * t10
    t12 = t6 + t11
    t16 = i6 - i0
    t17 = i3 - t16
    t18 = t17 * t17
    t19 = t12 + t18
    t22 = t19 - t21
    t24 = 2.0 * t5
    t26 = 2.0 * t10
    t28 = 2.0 * t17
    t31 = t24 * t3
    t32 = t26 * t8
    t33 = t31 + t32
    t34 = -(t33)
    t36 = t24 * t9
    t37 = t26 * t4
    t38 = t36 - t37
    t40 = -(t28)
    w[8] = t22
    w[9] = t24
    w[10] = t26
    w[11] = t28
    w[12] = t28
    w[13] = t34
    w[14] = t38
    w[15] = t40
    w[16] = t43


ADDRESSES = {
    "setup": law(setup, "19da92b91bd3138f"),
    "shared": idle(),
    "near": law(near, "19da92b91bd3138f"),
    "full": law(full, "19da92b91bd3138f"),
}
