"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 10), ('v', 8), ('c', 28)), 8, (), (), (), ('v',))
SIZE = 118
SHARED = (118, 118)


def full(w):
    i8 = w[8]
    i18 = w[18]
    i19 = w[19]
    i9 = w[9]
    i20 = w[20]
    i21 = w[21]
    i22 = w[22]
    i0 = w[0]
    i30 = w[30]
    i38 = w[38]
    i23 = w[23]
    i1 = w[1]
    i31 = w[31]
    i39 = w[39]
    i24 = w[24]
    i2 = w[2]
    i32 = w[32]
    i40 = w[40]
    i25 = w[25]
    i3 = w[3]
    i33 = w[33]
    i41 = w[41]
    i26 = w[26]
    i4 = w[4]
    i34 = w[34]
    i42 = w[42]
    i27 = w[27]
    i5 = w[5]
    i35 = w[35]
    i43 = w[43]
    i28 = w[28]
    i6 = w[6]
    i36 = w[36]
    i44 = w[44]
    i29 = w[29]
    i7 = w[7]
    i37 = w[37]
    i45 = w[45]
    i10 = w[10]
    i11 = w[11]
    i12 = w[12]
    i13 = w[13]
    i14 = w[14]
    i15 = w[15]
    i16 = w[16]
    i17 = w[17]
    t3 = i8 - i18
    t5 = t3 * i19
    t8 = i9 - i20
    t10 = t8 * i21
    t11 = t5 * t10
    t14 = i22 - i0
    t16 = i0 - i30
    t17 = max(t14, t16)
    t19 = max(t17, 0.0)
    t21 = t19 * i38
    t22 = t21 * t21
    t25 = i23 - i1
    t27 = i1 - i31
    t28 = max(t25, t27)
    t29 = max(t28, 0.0)
    t31 = t29 * i39
    t32 = t31 * t31
    t33 = t22 + t32
    t36 = i24 - i2
    t38 = i2 - i32
    t39 = max(t36, t38)
    t40 = max(t39, 0.0)
    t42 = t40 * i40
    t43 = t42 * t42
    t44 = t33 + t43
    t47 = i25 - i3
    t49 = i3 - i33
    t50 = max(t47, t49)
    t51 = max(t50, 0.0)
    t53 = t51 * i41
    t54 = t53 * t53
    t55 = t44 + t54
    t58 = i26 - i4
    t60 = i4 - i34
    t61 = max(t58, t60)
    t62 = max(t61, 0.0)
    t64 = t62 * i42
    t65 = t64 * t64
    t66 = t55 + t65
    t69 = i27 - i5
    t71 = i5 - i35
    t72 = max(t69, t71)
    t73 = max(t72, 0.0)
    t75 = t73 * i43
    t76 = t75 * t75
    t77 = t66 + t76
    t80 = i28 - i6
    t82 = i6 - i36
    t83 = max(t80, t82)
    t84 = max(t83, 0.0)
    t86 = t84 * i44
    t87 = t86 * t86
    t88 = t77 + t87
    t91 = i29 - i7
    t93 = i7 - i37
    t94 = max(t91, t93)
    t95 = max(t94, 0.0)
    t97 = t95 * i45
    t98 = t97 * t97
    t99 = t88 + t98
    t100 = -(t99)
    t101 = exp(t100)
    t102 = t11 * t101
    t103 = i10 * t102
    t106 = i11 * t102
    t109 = i12 * t102
    t112 = i13 * t102
    t115 = i14 * t102
    t118 = i15 * t102
    t121 = i16 * t102
    t124 = i17 * t102
    w[46] = t103
    w[47] = t106
    w[48] = t109
    w[49] = t112
    w[50] = t115
    w[51] = t118
    w[52] = t121
    w[53] = t124
    w[54] = t102
    w[63] = t102
    w[72] = t102
    w[81] = t102
    w[90] = t102
    w[99] = t102
    w[108] = t102
    w[117] = t102


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "de1c34e5601d0921"),
}
ADDRESSES["near"] = ADDRESSES["full"]
