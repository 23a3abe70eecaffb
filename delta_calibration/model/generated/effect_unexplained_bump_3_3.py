"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 4), ('v', 3), ('c', 14)), 3, (), (), (), ('v',))
SIZE = 33
SHARED = (33, 33)


def full(w):
    i11 = w[11]
    i3 = w[3]
    i0 = w[0]
    i7 = w[7]
    i1 = w[1]
    i8 = w[8]
    i2 = w[2]
    i9 = w[9]
    i10 = w[10]
    i12 = w[12]
    i15 = w[15]
    i18 = w[18]
    i13 = w[13]
    i16 = w[16]
    i19 = w[19]
    i14 = w[14]
    i17 = w[17]
    i20 = w[20]
    i4 = w[4]
    i5 = w[5]
    i6 = w[6]
    t3 = 1.0 if 0.0 < i11 else 0.0
    t5 = i3 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t12 = i0 - i7
    t13 = t12 * t12
    t16 = i1 - i8
    t17 = t16 * t16
    t18 = t13 + t17
    t21 = i2 - i9
    t22 = t21 * t21
    t23 = t18 + t22
    t25 = t23 * i10
    t27 = i12 - i0
    t29 = i0 - i15
    t30 = max(t27, t29)
    t31 = max(t30, 0.0)
    t33 = t31 * i18
    t34 = t33 * t33
    t36 = i13 - i1
    t38 = i1 - i16
    t39 = max(t36, t38)
    t40 = max(t39, 0.0)
    t42 = t40 * i19
    t43 = t42 * t42
    t44 = t34 + t43
    t46 = i14 - i2
    t48 = i2 - i17
    t49 = max(t46, t48)
    t50 = max(t49, 0.0)
    t52 = t50 * i20
    t53 = t52 * t52
    t54 = t44 + t53
    t55 = t25 + t54
    t56 = -(t55)
    t57 = exp(t56)
    t58 = t9 * t57
    t59 = i4 * t58
    t62 = i5 * t58
    t65 = i6 * t58
    w[21] = t59
    w[22] = t62
    w[23] = t65
    w[24] = t58
    w[28] = t58
    w[32] = t58


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "740b817f4af489e1"),
}
ADDRESSES["near"] = ADDRESSES["full"]
