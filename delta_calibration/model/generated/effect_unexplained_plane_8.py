"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 10), ('v', 1), ('c', 28)), 1, (), (), (), ('v',))
SIZE = 41
SHARED = (41, 41)


def full(w):
    i8 = w[8]
    i11 = w[11]
    i10 = w[10]
    i12 = w[12]
    i9 = w[9]
    i13 = w[13]
    i14 = w[14]
    i15 = w[15]
    i0 = w[0]
    i23 = w[23]
    i31 = w[31]
    i16 = w[16]
    i1 = w[1]
    i24 = w[24]
    i32 = w[32]
    i17 = w[17]
    i2 = w[2]
    i25 = w[25]
    i33 = w[33]
    i18 = w[18]
    i3 = w[3]
    i26 = w[26]
    i34 = w[34]
    i19 = w[19]
    i4 = w[4]
    i27 = w[27]
    i35 = w[35]
    i20 = w[20]
    i5 = w[5]
    i28 = w[28]
    i36 = w[36]
    i21 = w[21]
    i6 = w[6]
    i29 = w[29]
    i37 = w[37]
    i22 = w[22]
    i7 = w[7]
    i30 = w[30]
    i38 = w[38]
    t3 = i8 - i11
    t4 = i10 * t3
    t6 = t4 * i12
    t9 = i9 - i13
    t11 = t9 * i14
    t12 = t6 * t11
    t15 = i15 - i0
    t17 = i0 - i23
    t18 = max(t15, t17)
    t20 = max(t18, 0.0)
    t22 = t20 * i31
    t23 = t22 * t22
    t26 = i16 - i1
    t28 = i1 - i24
    t29 = max(t26, t28)
    t30 = max(t29, 0.0)
    t32 = t30 * i32
    t33 = t32 * t32
    t34 = t23 + t33
    t37 = i17 - i2
    t39 = i2 - i25
    t40 = max(t37, t39)
    t41 = max(t40, 0.0)
    t43 = t41 * i33
    t44 = t43 * t43
    t45 = t34 + t44
    t48 = i18 - i3
    t50 = i3 - i26
    t51 = max(t48, t50)
    t52 = max(t51, 0.0)
    t54 = t52 * i34
    t55 = t54 * t54
    t56 = t45 + t55
    t59 = i19 - i4
    t61 = i4 - i27
    t62 = max(t59, t61)
    t63 = max(t62, 0.0)
    t65 = t63 * i35
    t66 = t65 * t65
    t67 = t56 + t66
    t70 = i20 - i5
    t72 = i5 - i28
    t73 = max(t70, t72)
    t74 = max(t73, 0.0)
    t76 = t74 * i36
    t77 = t76 * t76
    t78 = t67 + t77
    t81 = i21 - i6
    t83 = i6 - i29
    t84 = max(t81, t83)
    t85 = max(t84, 0.0)
    t87 = t85 * i37
    t88 = t87 * t87
    t89 = t78 + t88
    t92 = i22 - i7
    t94 = i7 - i30
    t95 = max(t92, t94)
    t96 = max(t95, 0.0)
    t98 = t96 * i38
    t99 = t98 * t98
    t100 = t89 + t99
    t101 = -(t100)
    t102 = exp(t101)
    t103 = t12 * t102
    t105 = i12 * t3
    t106 = t11 * t105
    t107 = t102 * t106
    w[39] = t103
    w[40] = t107


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "d6351f10af7d70d8"),
}
ADDRESSES["near"] = ADDRESSES["full"]
