"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import sqrt

from delta_calibration.model.jit import idle, law

LAYOUT = ((('q', 1), ('x', 3), ('g', 5), ('c', 3)), 1, ('g', 'c'), ('x',), ('x', 'q'), ('g',))
SIZE = 27
SHARED = (27, 27)


def setup(w):
    i4 = w[4]
    i9 = w[9]
    i5 = w[5]
    i10 = w[10]
    i6 = w[6]
    i11 = w[11]
    i7 = w[7]
    t16 = i4 - i9
    t17 = t16 * t16
    t19 = i5 - i10
    t20 = t19 * t19
    t21 = t17 + t20
    t23 = i6 - i11
    t24 = t23 * t23
    t25 = t21 + t24
    t26 = sqrt(t25)
    w[22] = t26
    t44 = -(i7)
    w[23] = t44
    t46 = t16 / t26
    w[24] = t46
    t49 = t19 / t26
    w[25] = t49
    t52 = t23 / t26
    w[26] = t52


def near(w):
    i4 = w[4]
    i1 = w[1]
    i5 = w[5]
    i2 = w[2]
    i6 = w[6]
    i3 = w[3]
    t26 = w[22]
    i8 = w[8]
    i7 = w[7]
    i0 = w[0]
    t44 = w[23]
    t2 = i4 - i1
    t3 = t2 * t2
    t6 = i5 - i2
    t7 = t6 * t6
    t8 = t3 + t7
    t11 = i6 - i3
    t12 = t11 * t11
    t13 = t8 + t12
    t14 = sqrt(t13)
    t27 = t14 - t26
    t29 = t27 - i8
    t32 = i7 * i0
    t33 = t29 - t32
    t35 = t2 / t14
    t36 = -(t35)
    t38 = t6 / t14
    t39 = -(t38)
    t41 = t11 / t14
    t42 = -(t41)
    w[12] = t33
    w[13] = t36
    w[14] = t39
    w[15] = t42
    w[16] = t44


def full(w):
    i4 = w[4]
    i1 = w[1]
    i5 = w[5]
    i2 = w[2]
    i6 = w[6]
    i3 = w[3]
    t26 = w[22]
    i8 = w[8]
    i7 = w[7]
    i0 = w[0]
    t46 = w[24]
    t49 = w[25]
    t52 = w[26]
    t44 = w[23]
    t2 = i4 - i1
    t3 = t2 * t2
    t6 = i5 - i2
    t7 = t6 * t6
    t8 = t3 + t7
    t11 = i6 - i3
    t12 = t11 * t11
    t13 = t8 + t12
    t14 = sqrt(t13)
    t27 = t14 - t26
    t29 = t27 - i8
    t32 = i7 * i0
    t33 = t29 - t32
    t35 = t2 / t14
    t36 = -(t35)
    t38 = t6 / t14
    t39 = -(t38)
    t41 = t11 / t14
    t42 = -(t41)
    t47 = t35 - t46
    t50 = t38 - t49
    t53 = t41 - t52
    t55 = -(i0)
    w[12] = t33
    w[13] = t36
    w[14] = t39
    w[15] = t42
    w[16] = t44
    w[17] = t47
    w[18] = t50
    w[19] = t53
    w[20] = t55
    w[21] = (-1.0)


ADDRESSES = {
    "setup": law(setup, "36d52c91f16f7972"),
    "shared": idle(),
    "near": law(near, "36d52c91f16f7972"),
    "full": law(full, "36d52c91f16f7972"),
}
