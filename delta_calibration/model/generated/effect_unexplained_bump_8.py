"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 9), ('v', 1), ('c', 10)), 1, (), (), (), ('v',))
SIZE = 22
SHARED = (22, 22)


def full(w):
    i19 = w[19]
    i8 = w[8]
    i9 = w[9]
    i0 = w[0]
    i10 = w[10]
    i1 = w[1]
    i11 = w[11]
    i2 = w[2]
    i12 = w[12]
    i3 = w[3]
    i13 = w[13]
    i4 = w[4]
    i14 = w[14]
    i5 = w[5]
    i15 = w[15]
    i6 = w[6]
    i16 = w[16]
    i7 = w[7]
    i17 = w[17]
    i18 = w[18]
    t3 = 1.0 if 0.0 < i19 else 0.0
    t5 = i8 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t10 = i9 * t9
    t13 = i0 - i10
    t14 = t13 * t13
    t17 = i1 - i11
    t18 = t17 * t17
    t19 = t14 + t18
    t22 = i2 - i12
    t23 = t22 * t22
    t24 = t19 + t23
    t27 = i3 - i13
    t28 = t27 * t27
    t29 = t24 + t28
    t32 = i4 - i14
    t33 = t32 * t32
    t34 = t29 + t33
    t37 = i5 - i15
    t38 = t37 * t37
    t39 = t34 + t38
    t42 = i6 - i16
    t43 = t42 * t42
    t44 = t39 + t43
    t47 = i7 - i17
    t48 = t47 * t47
    t49 = t44 + t48
    t51 = t49 * i18
    t52 = -(t51)
    t53 = exp(t52)
    t54 = t10 * t53
    t56 = t53 * t9
    w[20] = t54
    w[21] = t56


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "9f99523c2cc12151"),
}
ADDRESSES["near"] = ADDRESSES["full"]
