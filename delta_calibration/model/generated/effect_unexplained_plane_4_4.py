"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 6), ('v', 4), ('c', 16)), 4, (), (), (), ('v',))
SIZE = 46
SHARED = (46, 46)


def full(w):
    i4 = w[4]
    i10 = w[10]
    i11 = w[11]
    i5 = w[5]
    i12 = w[12]
    i13 = w[13]
    i14 = w[14]
    i0 = w[0]
    i18 = w[18]
    i22 = w[22]
    i15 = w[15]
    i1 = w[1]
    i19 = w[19]
    i23 = w[23]
    i16 = w[16]
    i2 = w[2]
    i20 = w[20]
    i24 = w[24]
    i17 = w[17]
    i3 = w[3]
    i21 = w[21]
    i25 = w[25]
    i6 = w[6]
    i7 = w[7]
    i8 = w[8]
    i9 = w[9]
    t3 = i4 - i10
    t5 = t3 * i11
    t8 = i5 - i12
    t10 = t8 * i13
    t11 = t5 * t10
    t14 = i14 - i0
    t16 = i0 - i18
    t17 = max(t14, t16)
    t19 = max(t17, 0.0)
    t21 = t19 * i22
    t22 = t21 * t21
    t25 = i15 - i1
    t27 = i1 - i19
    t28 = max(t25, t27)
    t29 = max(t28, 0.0)
    t31 = t29 * i23
    t32 = t31 * t31
    t33 = t22 + t32
    t36 = i16 - i2
    t38 = i2 - i20
    t39 = max(t36, t38)
    t40 = max(t39, 0.0)
    t42 = t40 * i24
    t43 = t42 * t42
    t44 = t33 + t43
    t47 = i17 - i3
    t49 = i3 - i21
    t50 = max(t47, t49)
    t51 = max(t50, 0.0)
    t53 = t51 * i25
    t54 = t53 * t53
    t55 = t44 + t54
    t56 = -(t55)
    t57 = exp(t56)
    t58 = t11 * t57
    t59 = i6 * t58
    t62 = i7 * t58
    t65 = i8 * t58
    t68 = i9 * t58
    w[26] = t59
    w[27] = t62
    w[28] = t65
    w[29] = t68
    w[30] = t58
    w[35] = t58
    w[40] = t58
    w[45] = t58


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "b505f2ff093e3f72"),
}
ADDRESSES["near"] = ADDRESSES["full"]
