"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 9), ('v', 8), ('c', 34)), 8, (), (), (), ('v',))
SIZE = 123
SHARED = (123, 123)


def full(w):
    i26 = w[26]
    i8 = w[8]
    i0 = w[0]
    i17 = w[17]
    i1 = w[1]
    i18 = w[18]
    i2 = w[2]
    i19 = w[19]
    i3 = w[3]
    i20 = w[20]
    i4 = w[4]
    i21 = w[21]
    i5 = w[5]
    i22 = w[22]
    i6 = w[6]
    i23 = w[23]
    i7 = w[7]
    i24 = w[24]
    i25 = w[25]
    i27 = w[27]
    i35 = w[35]
    i43 = w[43]
    i28 = w[28]
    i36 = w[36]
    i44 = w[44]
    i29 = w[29]
    i37 = w[37]
    i45 = w[45]
    i30 = w[30]
    i38 = w[38]
    i46 = w[46]
    i31 = w[31]
    i39 = w[39]
    i47 = w[47]
    i32 = w[32]
    i40 = w[40]
    i48 = w[48]
    i33 = w[33]
    i41 = w[41]
    i49 = w[49]
    i34 = w[34]
    i42 = w[42]
    i50 = w[50]
    i9 = w[9]
    i10 = w[10]
    i11 = w[11]
    i12 = w[12]
    i13 = w[13]
    i14 = w[14]
    i15 = w[15]
    i16 = w[16]
    t3 = 1.0 if 0.0 < i26 else 0.0
    t5 = i8 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t12 = i0 - i17
    t13 = t12 * t12
    t16 = i1 - i18
    t17 = t16 * t16
    t18 = t13 + t17
    t21 = i2 - i19
    t22 = t21 * t21
    t23 = t18 + t22
    t26 = i3 - i20
    t27 = t26 * t26
    t28 = t23 + t27
    t31 = i4 - i21
    t32 = t31 * t31
    t33 = t28 + t32
    t36 = i5 - i22
    t37 = t36 * t36
    t38 = t33 + t37
    t41 = i6 - i23
    t42 = t41 * t41
    t43 = t38 + t42
    t46 = i7 - i24
    t47 = t46 * t46
    t48 = t43 + t47
    t50 = t48 * i25
    t52 = i27 - i0
    t54 = i0 - i35
    t55 = max(t52, t54)
    t56 = max(t55, 0.0)
    t58 = t56 * i43
    t59 = t58 * t58
    t61 = i28 - i1
    t63 = i1 - i36
    t64 = max(t61, t63)
    t65 = max(t64, 0.0)
    t67 = t65 * i44
    t68 = t67 * t67
    t69 = t59 + t68
    t71 = i29 - i2
    t73 = i2 - i37
    t74 = max(t71, t73)
    t75 = max(t74, 0.0)
    t77 = t75 * i45
    t78 = t77 * t77
    t79 = t69 + t78
    t81 = i30 - i3
    t83 = i3 - i38
    t84 = max(t81, t83)
    t85 = max(t84, 0.0)
    t87 = t85 * i46
    t88 = t87 * t87
    t89 = t79 + t88
    t91 = i31 - i4
    t93 = i4 - i39
    t94 = max(t91, t93)
    t95 = max(t94, 0.0)
    t97 = t95 * i47
    t98 = t97 * t97
    t99 = t89 + t98
    t101 = i32 - i5
    t103 = i5 - i40
    t104 = max(t101, t103)
    t105 = max(t104, 0.0)
    t107 = t105 * i48
    t108 = t107 * t107
    t109 = t99 + t108
    t111 = i33 - i6
    t113 = i6 - i41
    t114 = max(t111, t113)
    t115 = max(t114, 0.0)
    t117 = t115 * i49
    t118 = t117 * t117
    t119 = t109 + t118
    t121 = i34 - i7
    t123 = i7 - i42
    t124 = max(t121, t123)
    t125 = max(t124, 0.0)
    t127 = t125 * i50
    t128 = t127 * t127
    t129 = t119 + t128
    t130 = t50 + t129
    t131 = -(t130)
    t132 = exp(t131)
    t133 = t9 * t132
    t134 = i9 * t133
    t137 = i10 * t133
    t140 = i11 * t133
    t143 = i12 * t133
    t146 = i13 * t133
    t149 = i14 * t133
    t152 = i15 * t133
    t155 = i16 * t133
    w[51] = t134
    w[52] = t137
    w[53] = t140
    w[54] = t143
    w[55] = t146
    w[56] = t149
    w[57] = t152
    w[58] = t155
    w[59] = t133
    w[68] = t133
    w[77] = t133
    w[86] = t133
    w[95] = t133
    w[104] = t133
    w[113] = t133
    w[122] = t133


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "fa9def45cd16c07e"),
}
ADDRESSES["near"] = ADDRESSES["full"]
