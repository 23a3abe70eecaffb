"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 8), ('v', 7), ('c', 30)), 7, (), (), (), ('v',))
SIZE = 101
SHARED = (101, 101)


def full(w):
    i23 = w[23]
    i7 = w[7]
    i0 = w[0]
    i15 = w[15]
    i1 = w[1]
    i16 = w[16]
    i2 = w[2]
    i17 = w[17]
    i3 = w[3]
    i18 = w[18]
    i4 = w[4]
    i19 = w[19]
    i5 = w[5]
    i20 = w[20]
    i6 = w[6]
    i21 = w[21]
    i22 = w[22]
    i24 = w[24]
    i31 = w[31]
    i38 = w[38]
    i25 = w[25]
    i32 = w[32]
    i39 = w[39]
    i26 = w[26]
    i33 = w[33]
    i40 = w[40]
    i27 = w[27]
    i34 = w[34]
    i41 = w[41]
    i28 = w[28]
    i35 = w[35]
    i42 = w[42]
    i29 = w[29]
    i36 = w[36]
    i43 = w[43]
    i30 = w[30]
    i37 = w[37]
    i44 = w[44]
    i8 = w[8]
    i9 = w[9]
    i10 = w[10]
    i11 = w[11]
    i12 = w[12]
    i13 = w[13]
    i14 = w[14]
    t3 = 1.0 if 0.0 < i23 else 0.0
    t5 = i7 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t12 = i0 - i15
    t13 = t12 * t12
    t16 = i1 - i16
    t17 = t16 * t16
    t18 = t13 + t17
    t21 = i2 - i17
    t22 = t21 * t21
    t23 = t18 + t22
    t26 = i3 - i18
    t27 = t26 * t26
    t28 = t23 + t27
    t31 = i4 - i19
    t32 = t31 * t31
    t33 = t28 + t32
    t36 = i5 - i20
    t37 = t36 * t36
    t38 = t33 + t37
    t41 = i6 - i21
    t42 = t41 * t41
    t43 = t38 + t42
    t45 = t43 * i22
    t47 = i24 - i0
    t49 = i0 - i31
    t50 = max(t47, t49)
    t51 = max(t50, 0.0)
    t53 = t51 * i38
    t54 = t53 * t53
    t56 = i25 - i1
    t58 = i1 - i32
    t59 = max(t56, t58)
    t60 = max(t59, 0.0)
    t62 = t60 * i39
    t63 = t62 * t62
    t64 = t54 + t63
    t66 = i26 - i2
    t68 = i2 - i33
    t69 = max(t66, t68)
    t70 = max(t69, 0.0)
    t72 = t70 * i40
    t73 = t72 * t72
    t74 = t64 + t73
    t76 = i27 - i3
    t78 = i3 - i34
    t79 = max(t76, t78)
    t80 = max(t79, 0.0)
    t82 = t80 * i41
    t83 = t82 * t82
    t84 = t74 + t83
    t86 = i28 - i4
    t88 = i4 - i35
    t89 = max(t86, t88)
    t90 = max(t89, 0.0)
    t92 = t90 * i42
    t93 = t92 * t92
    t94 = t84 + t93
    t96 = i29 - i5
    t98 = i5 - i36
    t99 = max(t96, t98)
    t100 = max(t99, 0.0)
    t102 = t100 * i43
    t103 = t102 * t102
    t104 = t94 + t103
    t106 = i30 - i6
    t108 = i6 - i37
    t109 = max(t106, t108)
    t110 = max(t109, 0.0)
    t112 = t110 * i44
    t113 = t112 * t112
    t114 = t104 + t113
    t115 = t45 + t114
    t116 = -(t115)
    t117 = exp(t116)
    t118 = t9 * t117
    t119 = i8 * t118
    t122 = i9 * t118
    t125 = i10 * t118
    t128 = i11 * t118
    t131 = i12 * t118
    t134 = i13 * t118
    t137 = i14 * t118
    w[45] = t119
    w[46] = t122
    w[47] = t125
    w[48] = t128
    w[49] = t131
    w[50] = t134
    w[51] = t137
    w[52] = t118
    w[60] = t118
    w[68] = t118
    w[76] = t118
    w[84] = t118
    w[92] = t118
    w[100] = t118


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "ee91431f4f3a3d42"),
}
ADDRESSES["near"] = ADDRESSES["full"]
