"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 6), ('v', 5), ('c', 22)), 5, (), (), (), ('v',))
SIZE = 63
SHARED = (63, 63)


def full(w):
    i17 = w[17]
    i5 = w[5]
    i0 = w[0]
    i11 = w[11]
    i1 = w[1]
    i12 = w[12]
    i2 = w[2]
    i13 = w[13]
    i3 = w[3]
    i14 = w[14]
    i4 = w[4]
    i15 = w[15]
    i16 = w[16]
    i18 = w[18]
    i23 = w[23]
    i28 = w[28]
    i19 = w[19]
    i24 = w[24]
    i29 = w[29]
    i20 = w[20]
    i25 = w[25]
    i30 = w[30]
    i21 = w[21]
    i26 = w[26]
    i31 = w[31]
    i22 = w[22]
    i27 = w[27]
    i32 = w[32]
    i6 = w[6]
    i7 = w[7]
    i8 = w[8]
    i9 = w[9]
    i10 = w[10]
    t3 = 1.0 if 0.0 < i17 else 0.0
    t5 = i5 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t12 = i0 - i11
    t13 = t12 * t12
    t16 = i1 - i12
    t17 = t16 * t16
    t18 = t13 + t17
    t21 = i2 - i13
    t22 = t21 * t21
    t23 = t18 + t22
    t26 = i3 - i14
    t27 = t26 * t26
    t28 = t23 + t27
    t31 = i4 - i15
    t32 = t31 * t31
    t33 = t28 + t32
    t35 = t33 * i16
    t37 = i18 - i0
    t39 = i0 - i23
    t40 = max(t37, t39)
    t41 = max(t40, 0.0)
    t43 = t41 * i28
    t44 = t43 * t43
    t46 = i19 - i1
    t48 = i1 - i24
    t49 = max(t46, t48)
    t50 = max(t49, 0.0)
    t52 = t50 * i29
    t53 = t52 * t52
    t54 = t44 + t53
    t56 = i20 - i2
    t58 = i2 - i25
    t59 = max(t56, t58)
    t60 = max(t59, 0.0)
    t62 = t60 * i30
    t63 = t62 * t62
    t64 = t54 + t63
    t66 = i21 - i3
    t68 = i3 - i26
    t69 = max(t66, t68)
    t70 = max(t69, 0.0)
    t72 = t70 * i31
    t73 = t72 * t72
    t74 = t64 + t73
    t76 = i22 - i4
    t78 = i4 - i27
    t79 = max(t76, t78)
    t80 = max(t79, 0.0)
    t82 = t80 * i32
    t83 = t82 * t82
    t84 = t74 + t83
    t85 = t35 + t84
    t86 = -(t85)
    t87 = exp(t86)
    t88 = t9 * t87
    t89 = i6 * t88
    t92 = i7 * t88
    t95 = i8 * t88
    t98 = i9 * t88
    t101 = i10 * t88
    w[33] = t89
    w[34] = t92
    w[35] = t95
    w[36] = t98
    w[37] = t101
    w[38] = t88
    w[44] = t88
    w[50] = t88
    w[56] = t88
    w[62] = t88


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "d91dc22801e232c5"),
}
ADDRESSES["near"] = ADDRESSES["full"]
