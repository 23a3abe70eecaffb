"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 4), ('v', 1), ('c', 14)), 1, (), (), (), ('v',))
SIZE = 21
SHARED = (21, 21)


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
    i10 = w[10]
    i13 = w[13]
    i16 = w[16]
    i11 = w[11]
    i14 = w[14]
    i17 = w[17]
    i12 = w[12]
    i15 = w[15]
    i18 = w[18]
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
    t28 = i10 - i0
    t30 = i0 - i13
    t31 = max(t28, t30)
    t32 = max(t31, 0.0)
    t34 = t32 * i16
    t35 = t34 * t34
    t37 = i11 - i1
    t39 = i1 - i14
    t40 = max(t37, t39)
    t41 = max(t40, 0.0)
    t43 = t41 * i17
    t44 = t43 * t43
    t45 = t35 + t44
    t47 = i12 - i2
    t49 = i2 - i15
    t50 = max(t47, t49)
    t51 = max(t50, 0.0)
    t53 = t51 * i18
    t54 = t53 * t53
    t55 = t45 + t54
    t56 = t26 + t55
    t57 = -(t56)
    t58 = exp(t57)
    t59 = t10 * t58
    t61 = t58 * t9
    w[19] = t59
    w[20] = t61


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "43d206ddf35f8aa4"),
}
ADDRESSES["near"] = ADDRESSES["full"]
