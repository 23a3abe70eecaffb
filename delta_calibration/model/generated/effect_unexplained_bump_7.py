"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 8), ('v', 1), ('c', 30)), 1, (), (), (), ('v',))
SIZE = 41
SHARED = (41, 41)


def full(w):
    i17 = w[17]
    i7 = w[7]
    i8 = w[8]
    i0 = w[0]
    i9 = w[9]
    i1 = w[1]
    i10 = w[10]
    i2 = w[2]
    i11 = w[11]
    i3 = w[3]
    i12 = w[12]
    i4 = w[4]
    i13 = w[13]
    i5 = w[5]
    i14 = w[14]
    i6 = w[6]
    i15 = w[15]
    i16 = w[16]
    i18 = w[18]
    i25 = w[25]
    i32 = w[32]
    i19 = w[19]
    i26 = w[26]
    i33 = w[33]
    i20 = w[20]
    i27 = w[27]
    i34 = w[34]
    i21 = w[21]
    i28 = w[28]
    i35 = w[35]
    i22 = w[22]
    i29 = w[29]
    i36 = w[36]
    i23 = w[23]
    i30 = w[30]
    i37 = w[37]
    i24 = w[24]
    i31 = w[31]
    i38 = w[38]
    t3 = 1.0 if 0.0 < i17 else 0.0
    t5 = i7 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t10 = i8 * t9
    t13 = i0 - i9
    t14 = t13 * t13
    t17 = i1 - i10
    t18 = t17 * t17
    t19 = t14 + t18
    t22 = i2 - i11
    t23 = t22 * t22
    t24 = t19 + t23
    t27 = i3 - i12
    t28 = t27 * t27
    t29 = t24 + t28
    t32 = i4 - i13
    t33 = t32 * t32
    t34 = t29 + t33
    t37 = i5 - i14
    t38 = t37 * t37
    t39 = t34 + t38
    t42 = i6 - i15
    t43 = t42 * t42
    t44 = t39 + t43
    t46 = t44 * i16
    t48 = i18 - i0
    t50 = i0 - i25
    t51 = max(t48, t50)
    t52 = max(t51, 0.0)
    t54 = t52 * i32
    t55 = t54 * t54
    t57 = i19 - i1
    t59 = i1 - i26
    t60 = max(t57, t59)
    t61 = max(t60, 0.0)
    t63 = t61 * i33
    t64 = t63 * t63
    t65 = t55 + t64
    t67 = i20 - i2
    t69 = i2 - i27
    t70 = max(t67, t69)
    t71 = max(t70, 0.0)
    t73 = t71 * i34
    t74 = t73 * t73
    t75 = t65 + t74
    t77 = i21 - i3
    t79 = i3 - i28
    t80 = max(t77, t79)
    t81 = max(t80, 0.0)
    t83 = t81 * i35
    t84 = t83 * t83
    t85 = t75 + t84
    t87 = i22 - i4
    t89 = i4 - i29
    t90 = max(t87, t89)
    t91 = max(t90, 0.0)
    t93 = t91 * i36
    t94 = t93 * t93
    t95 = t85 + t94
    t97 = i23 - i5
    t99 = i5 - i30
    t100 = max(t97, t99)
    t101 = max(t100, 0.0)
    t103 = t101 * i37
    t104 = t103 * t103
    t105 = t95 + t104
    t107 = i24 - i6
    t109 = i6 - i31
    t110 = max(t107, t109)
    t111 = max(t110, 0.0)
    t113 = t111 * i38
    t114 = t113 * t113
    t115 = t105 + t114
    t116 = t46 + t115
    t117 = -(t116)
    t118 = exp(t117)
    t119 = t10 * t118
    t121 = t118 * t9
    w[39] = t119
    w[40] = t121


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "051911b6a4e563d1"),
}
ADDRESSES["near"] = ADDRESSES["full"]
