"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 5), ('v', 1), ('c', 18)), 1, (), (), (), ('v',))
SIZE = 26
SHARED = (26, 26)


def full(w):
    i11 = w[11]
    i4 = w[4]
    i5 = w[5]
    i0 = w[0]
    i6 = w[6]
    i1 = w[1]
    i7 = w[7]
    i2 = w[2]
    i8 = w[8]
    i3 = w[3]
    i9 = w[9]
    i10 = w[10]
    i12 = w[12]
    i16 = w[16]
    i20 = w[20]
    i13 = w[13]
    i17 = w[17]
    i21 = w[21]
    i14 = w[14]
    i18 = w[18]
    i22 = w[22]
    i15 = w[15]
    i19 = w[19]
    i23 = w[23]
    t3 = 1.0 if 0.0 < i11 else 0.0
    t5 = i4 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t10 = i5 * t9
    t13 = i0 - i6
    t14 = t13 * t13
    t17 = i1 - i7
    t18 = t17 * t17
    t19 = t14 + t18
    t22 = i2 - i8
    t23 = t22 * t22
    t24 = t19 + t23
    t27 = i3 - i9
    t28 = t27 * t27
    t29 = t24 + t28
    t31 = t29 * i10
    t33 = i12 - i0
    t35 = i0 - i16
    t36 = max(t33, t35)
    t37 = max(t36, 0.0)
    t39 = t37 * i20
    t40 = t39 * t39
    t42 = i13 - i1
    t44 = i1 - i17
    t45 = max(t42, t44)
    t46 = max(t45, 0.0)
    t48 = t46 * i21
    t49 = t48 * t48
    t50 = t40 + t49
    t52 = i14 - i2
    t54 = i2 - i18
    t55 = max(t52, t54)
    t56 = max(t55, 0.0)
    t58 = t56 * i22
    t59 = t58 * t58
    t60 = t50 + t59
    t62 = i15 - i3
    t64 = i3 - i19
    t65 = max(t62, t64)
    t66 = max(t65, 0.0)
    t68 = t66 * i23
    t69 = t68 * t68
    t70 = t60 + t69
    t71 = t31 + t70
    t72 = -(t71)
    t73 = exp(t72)
    t74 = t10 * t73
    t76 = t73 * t9
    w[24] = t74
    w[25] = t76


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "1cc60ec670dce9fc"),
}
ADDRESSES["near"] = ADDRESSES["full"]
