"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 7), ('v', 1), ('c', 19)), 1, (), (), (), ('v',))
SIZE = 29
SHARED = (29, 29)


def full(w):
    i5 = w[5]
    i8 = w[8]
    i7 = w[7]
    i9 = w[9]
    i6 = w[6]
    i10 = w[10]
    i11 = w[11]
    i12 = w[12]
    i0 = w[0]
    i17 = w[17]
    i22 = w[22]
    i13 = w[13]
    i1 = w[1]
    i18 = w[18]
    i23 = w[23]
    i14 = w[14]
    i2 = w[2]
    i19 = w[19]
    i24 = w[24]
    i15 = w[15]
    i3 = w[3]
    i20 = w[20]
    i25 = w[25]
    i16 = w[16]
    i4 = w[4]
    i21 = w[21]
    i26 = w[26]
    t3 = i5 - i8
    t4 = i7 * t3
    t6 = t4 * i9
    t9 = i6 - i10
    t11 = t9 * i11
    t12 = t6 * t11
    t15 = i12 - i0
    t17 = i0 - i17
    t18 = max(t15, t17)
    t20 = max(t18, 0.0)
    t22 = t20 * i22
    t23 = t22 * t22
    t26 = i13 - i1
    t28 = i1 - i18
    t29 = max(t26, t28)
    t30 = max(t29, 0.0)
    t32 = t30 * i23
    t33 = t32 * t32
    t34 = t23 + t33
    t37 = i14 - i2
    t39 = i2 - i19
    t40 = max(t37, t39)
    t41 = max(t40, 0.0)
    t43 = t41 * i24
    t44 = t43 * t43
    t45 = t34 + t44
    t48 = i15 - i3
    t50 = i3 - i20
    t51 = max(t48, t50)
    t52 = max(t51, 0.0)
    t54 = t52 * i25
    t55 = t54 * t54
    t56 = t45 + t55
    t59 = i16 - i4
    t61 = i4 - i21
    t62 = max(t59, t61)
    t63 = max(t62, 0.0)
    t65 = t63 * i26
    t66 = t65 * t65
    t67 = t56 + t66
    t68 = -(t67)
    t69 = exp(t68)
    t70 = t12 * t69
    t72 = i9 * t3
    t73 = t11 * t72
    t74 = t69 * t73
    w[27] = t70
    w[28] = t74


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "9fc6c9e2deb7bb2a"),
}
ADDRESSES["near"] = ADDRESSES["full"]
