"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 9), ('v', 1), ('c', 25)), 1, (), (), (), ('v',))
SIZE = 37
SHARED = (37, 37)


def full(w):
    i7 = w[7]
    i10 = w[10]
    i9 = w[9]
    i11 = w[11]
    i8 = w[8]
    i12 = w[12]
    i13 = w[13]
    i14 = w[14]
    i0 = w[0]
    i21 = w[21]
    i28 = w[28]
    i15 = w[15]
    i1 = w[1]
    i22 = w[22]
    i29 = w[29]
    i16 = w[16]
    i2 = w[2]
    i23 = w[23]
    i30 = w[30]
    i17 = w[17]
    i3 = w[3]
    i24 = w[24]
    i31 = w[31]
    i18 = w[18]
    i4 = w[4]
    i25 = w[25]
    i32 = w[32]
    i19 = w[19]
    i5 = w[5]
    i26 = w[26]
    i33 = w[33]
    i20 = w[20]
    i6 = w[6]
    i27 = w[27]
    i34 = w[34]
    t3 = i7 - i10
    t4 = i9 * t3
    t6 = t4 * i11
    t9 = i8 - i12
    t11 = t9 * i13
    t12 = t6 * t11
    t15 = i14 - i0
    t17 = i0 - i21
    t18 = max(t15, t17)
    t20 = max(t18, 0.0)
    t22 = t20 * i28
    t23 = t22 * t22
    t26 = i15 - i1
    t28 = i1 - i22
    t29 = max(t26, t28)
    t30 = max(t29, 0.0)
    t32 = t30 * i29
    t33 = t32 * t32
    t34 = t23 + t33
    t37 = i16 - i2
    t39 = i2 - i23
    t40 = max(t37, t39)
    t41 = max(t40, 0.0)
    t43 = t41 * i30
    t44 = t43 * t43
    t45 = t34 + t44
    t48 = i17 - i3
    t50 = i3 - i24
    t51 = max(t48, t50)
    t52 = max(t51, 0.0)
    t54 = t52 * i31
    t55 = t54 * t54
    t56 = t45 + t55
    t59 = i18 - i4
    t61 = i4 - i25
    t62 = max(t59, t61)
    t63 = max(t62, 0.0)
    t65 = t63 * i32
    t66 = t65 * t65
    t67 = t56 + t66
    t70 = i19 - i5
    t72 = i5 - i26
    t73 = max(t70, t72)
    t74 = max(t73, 0.0)
    t76 = t74 * i33
    t77 = t76 * t76
    t78 = t67 + t77
    t81 = i20 - i6
    t83 = i6 - i27
    t84 = max(t81, t83)
    t85 = max(t84, 0.0)
    t87 = t85 * i34
    t88 = t87 * t87
    t89 = t78 + t88
    t90 = -(t89)
    t91 = exp(t90)
    t92 = t12 * t91
    t94 = i11 * t3
    t95 = t11 * t94
    t96 = t91 * t95
    w[35] = t92
    w[36] = t96


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "c6025bc00df26637"),
}
ADDRESSES["near"] = ADDRESSES["full"]
