"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 9), ('v', 1), ('c', 34)), 1, (), (), (), ('v',))
SIZE = 46
SHARED = (46, 46)


def full(w):
    i19 = w[19]
    i8 = w[8]
    i9 = w[9]
    i0 = w[0]
    i10 = w[10]
    i1 = w[1]
    i11 = w[11]
    i2 = w[2]
    i12 = w[12]
    i3 = w[3]
    i13 = w[13]
    i4 = w[4]
    i14 = w[14]
    i5 = w[5]
    i15 = w[15]
    i6 = w[6]
    i16 = w[16]
    i7 = w[7]
    i17 = w[17]
    i18 = w[18]
    i20 = w[20]
    i28 = w[28]
    i36 = w[36]
    i21 = w[21]
    i29 = w[29]
    i37 = w[37]
    i22 = w[22]
    i30 = w[30]
    i38 = w[38]
    i23 = w[23]
    i31 = w[31]
    i39 = w[39]
    i24 = w[24]
    i32 = w[32]
    i40 = w[40]
    i25 = w[25]
    i33 = w[33]
    i41 = w[41]
    i26 = w[26]
    i34 = w[34]
    i42 = w[42]
    i27 = w[27]
    i35 = w[35]
    i43 = w[43]
    t3 = 1.0 if 0.0 < i19 else 0.0
    t5 = i8 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t10 = i9 * t9
    t13 = i0 - i10
    t14 = t13 * t13
    t17 = i1 - i11
    t18 = t17 * t17
    t19 = t14 + t18
    t22 = i2 - i12
    t23 = t22 * t22
    t24 = t19 + t23
    t27 = i3 - i13
    t28 = t27 * t27
    t29 = t24 + t28
    t32 = i4 - i14
    t33 = t32 * t32
    t34 = t29 + t33
    t37 = i5 - i15
    t38 = t37 * t37
    t39 = t34 + t38
    t42 = i6 - i16
    t43 = t42 * t42
    t44 = t39 + t43
    t47 = i7 - i17
    t48 = t47 * t47
    t49 = t44 + t48
    t51 = t49 * i18
    t53 = i20 - i0
    t55 = i0 - i28
    t56 = max(t53, t55)
    t57 = max(t56, 0.0)
    t59 = t57 * i36
    t60 = t59 * t59
    t62 = i21 - i1
    t64 = i1 - i29
    t65 = max(t62, t64)
    t66 = max(t65, 0.0)
    t68 = t66 * i37
    t69 = t68 * t68
    t70 = t60 + t69
    t72 = i22 - i2
    t74 = i2 - i30
    t75 = max(t72, t74)
    t76 = max(t75, 0.0)
    t78 = t76 * i38
    t79 = t78 * t78
    t80 = t70 + t79
    t82 = i23 - i3
    t84 = i3 - i31
    t85 = max(t82, t84)
    t86 = max(t85, 0.0)
    t88 = t86 * i39
    t89 = t88 * t88
    t90 = t80 + t89
    t92 = i24 - i4
    t94 = i4 - i32
    t95 = max(t92, t94)
    t96 = max(t95, 0.0)
    t98 = t96 * i40
    t99 = t98 * t98
    t100 = t90 + t99
    t102 = i25 - i5
    t104 = i5 - i33
    t105 = max(t102, t104)
    t106 = max(t105, 0.0)
    t108 = t106 * i41
    t109 = t108 * t108
    t110 = t100 + t109
    t112 = i26 - i6
    t114 = i6 - i34
    t115 = max(t112, t114)
    t116 = max(t115, 0.0)
    t118 = t116 * i42
    t119 = t118 * t118
    t120 = t110 + t119
    t122 = i27 - i7
    t124 = i7 - i35
    t125 = max(t122, t124)
    t126 = max(t125, 0.0)
    t128 = t126 * i43
    t129 = t128 * t128
    t130 = t120 + t129
    t131 = t51 + t130
    t132 = -(t131)
    t133 = exp(t132)
    t134 = t10 * t133
    t136 = t133 * t9
    w[44] = t134
    w[45] = t136


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "5b9f9464fccf0051"),
}
ADDRESSES["near"] = ADDRESSES["full"]
