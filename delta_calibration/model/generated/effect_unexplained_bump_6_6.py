"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 7), ('v', 6), ('c', 26)), 6, (), (), (), ('v',))
SIZE = 81
SHARED = (81, 81)


def full(w):
    i20 = w[20]
    i6 = w[6]
    i0 = w[0]
    i13 = w[13]
    i1 = w[1]
    i14 = w[14]
    i2 = w[2]
    i15 = w[15]
    i3 = w[3]
    i16 = w[16]
    i4 = w[4]
    i17 = w[17]
    i5 = w[5]
    i18 = w[18]
    i19 = w[19]
    i21 = w[21]
    i27 = w[27]
    i33 = w[33]
    i22 = w[22]
    i28 = w[28]
    i34 = w[34]
    i23 = w[23]
    i29 = w[29]
    i35 = w[35]
    i24 = w[24]
    i30 = w[30]
    i36 = w[36]
    i25 = w[25]
    i31 = w[31]
    i37 = w[37]
    i26 = w[26]
    i32 = w[32]
    i38 = w[38]
    i7 = w[7]
    i8 = w[8]
    i9 = w[9]
    i10 = w[10]
    i11 = w[11]
    i12 = w[12]
    t3 = 1.0 if 0.0 < i20 else 0.0
    t5 = i6 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t12 = i0 - i13
    t13 = t12 * t12
    t16 = i1 - i14
    t17 = t16 * t16
    t18 = t13 + t17
    t21 = i2 - i15
    t22 = t21 * t21
    t23 = t18 + t22
    t26 = i3 - i16
    t27 = t26 * t26
    t28 = t23 + t27
    t31 = i4 - i17
    t32 = t31 * t31
    t33 = t28 + t32
    t36 = i5 - i18
    t37 = t36 * t36
    t38 = t33 + t37
    t40 = t38 * i19
    t42 = i21 - i0
    t44 = i0 - i27
    t45 = max(t42, t44)
    t46 = max(t45, 0.0)
    t48 = t46 * i33
    t49 = t48 * t48
    t51 = i22 - i1
    t53 = i1 - i28
    t54 = max(t51, t53)
    t55 = max(t54, 0.0)
    t57 = t55 * i34
    t58 = t57 * t57
    t59 = t49 + t58
    t61 = i23 - i2
    t63 = i2 - i29
    t64 = max(t61, t63)
    t65 = max(t64, 0.0)
    t67 = t65 * i35
    t68 = t67 * t67
    t69 = t59 + t68
    t71 = i24 - i3
    t73 = i3 - i30
    t74 = max(t71, t73)
    t75 = max(t74, 0.0)
    t77 = t75 * i36
    t78 = t77 * t77
    t79 = t69 + t78
    t81 = i25 - i4
    t83 = i4 - i31
    t84 = max(t81, t83)
    t85 = max(t84, 0.0)
    t87 = t85 * i37
    t88 = t87 * t87
    t89 = t79 + t88
    t91 = i26 - i5
    t93 = i5 - i32
    t94 = max(t91, t93)
    t95 = max(t94, 0.0)
    t97 = t95 * i38
    t98 = t97 * t97
    t99 = t89 + t98
    t100 = t40 + t99
    t101 = -(t100)
    t102 = exp(t101)
    t103 = t9 * t102
    t104 = i7 * t103
    t107 = i8 * t103
    t110 = i9 * t103
    t113 = i10 * t103
    t116 = i11 * t103
    t119 = i12 * t103
    w[39] = t104
    w[40] = t107
    w[41] = t110
    w[42] = t113
    w[43] = t116
    w[44] = t119
    w[45] = t103
    w[52] = t103
    w[59] = t103
    w[66] = t103
    w[73] = t103
    w[80] = t103


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "fcea074909d60140"),
}
ADDRESSES["near"] = ADDRESSES["full"]
