"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import cos, sin, sqrt

from delta_calibration.model.jit import idle, law

LAYOUT = ((('x', 6), ('g', 8), ('c', 6)), 1, ('g', 'c'), (), (), ())
SIZE = 22
SHARED = (22, 22)


def setup(w):
    i6 = w[6]
    i14 = w[14]
    i17 = w[17]
    i18 = w[18]
    i19 = w[19]
    i9 = w[9]
    i10 = w[10]
    i11 = w[11]
    i7 = w[7]
    i15 = w[15]
    i8 = w[8]
    i16 = w[16]
    t87 = i6 - i14
    t89 = i17 * i17
    t91 = i18 * i18
    t92 = t89 + t91
    t94 = i19 * i19
    t95 = t92 + t94
    t96 = t95 + 1e-300
    t97 = sqrt(t96)
    t98 = t97 / 2.0
    t99 = sin(t98)
    t100 = t99 / t98
    t101 = t100 * t100
    t102 = t101 / 2.0
    t103 = t94 + t91
    t104 = t102 * t103
    t105 = 1.0 - t104
    t106 = t105 * i9
    t107 = i18 * i17
    t108 = t102 * t107
    t109 = cos(t98)
    t110 = t100 * t109
    t111 = t110 * i19
    t112 = t108 - t111
    t113 = t112 * i10
    t114 = t106 + t113
    t115 = t110 * i18
    t116 = i19 * i17
    t117 = t102 * t116
    t118 = t115 + t117
    t119 = t118 * i11
    t120 = t114 + t119
    t121 = t87 - t120
    t122 = t121 * t121
    t124 = i7 - i15
    t125 = i17 * i18
    t126 = t102 * t125
    t127 = t111 + t126
    t128 = t127 * i9
    t129 = t94 + t89
    t130 = t102 * t129
    t131 = 1.0 - t130
    t132 = t131 * i10
    t133 = t128 + t132
    t134 = i19 * i18
    t135 = t102 * t134
    t136 = t110 * i17
    t137 = t135 - t136
    t138 = t137 * i11
    t139 = t133 + t138
    t140 = t124 - t139
    t141 = t140 * t140
    t142 = t122 + t141
    t144 = i8 - i16
    t145 = i17 * i19
    t146 = t102 * t145
    t147 = t146 - t115
    t148 = t147 * i9
    t149 = i18 * i19
    t150 = t102 * t149
    t151 = t136 + t150
    t152 = t151 * i10
    t153 = t148 + t152
    t154 = t91 + t89
    t155 = t102 * t154
    t156 = 1.0 - t155
    t157 = t156 * i11
    t158 = t153 + t157
    t159 = t144 - t158
    t160 = t159 * t159
    t161 = t142 + t160
    t162 = sqrt(t161)
    w[21] = t162


def full(w):
    i6 = w[6]
    i0 = w[0]
    i3 = w[3]
    i4 = w[4]
    i5 = w[5]
    i9 = w[9]
    i10 = w[10]
    i11 = w[11]
    i7 = w[7]
    i1 = w[1]
    i8 = w[8]
    i2 = w[2]
    t162 = w[21]
    i13 = w[13]
    i12 = w[12]
    t2 = i6 - i0
    t5 = i3 * i3
    t7 = i4 * i4
    t8 = t5 + t7
    t10 = i5 * i5
    t11 = t8 + t10
    t13 = t11 + 1e-300
    t14 = sqrt(t13)
    t16 = t14 / 2.0
    t17 = sin(t16)
    t18 = t17 / t16
    t19 = t18 * t18
    t20 = t19 / 2.0
    t21 = t10 + t7
    t22 = t20 * t21
    t23 = 1.0 - t22
    t25 = t23 * i9
    t26 = i4 * i3
    t27 = t20 * t26
    t28 = cos(t16)
    t29 = t18 * t28
    t30 = t29 * i5
    t31 = t27 - t30
    t33 = t31 * i10
    t34 = t25 + t33
    t35 = t29 * i4
    t36 = i5 * i3
    t37 = t20 * t36
    t38 = t35 + t37
    t40 = t38 * i11
    t41 = t34 + t40
    t42 = t2 - t41
    t43 = t42 * t42
    t46 = i7 - i1
    t47 = i3 * i4
    t48 = t20 * t47
    t49 = t30 + t48
    t50 = t49 * i9
    t51 = t10 + t5
    t52 = t20 * t51
    t53 = 1.0 - t52
    t54 = t53 * i10
    t55 = t50 + t54
    t56 = i5 * i4
    t57 = t20 * t56
    t58 = t29 * i3
    t59 = t57 - t58
    t60 = t59 * i11
    t61 = t55 + t60
    t62 = t46 - t61
    t63 = t62 * t62
    t64 = t43 + t63
    t67 = i8 - i2
    t68 = i3 * i5
    t69 = t20 * t68
    t70 = t69 - t35
    t71 = t70 * i9
    t72 = i4 * i5
    t73 = t20 * t72
    t74 = t58 + t73
    t75 = t74 * i10
    t76 = t71 + t75
    t77 = t7 + t5
    t78 = t20 * t77
    t79 = 1.0 - t78
    t80 = t79 * i11
    t81 = t76 + t80
    t82 = t67 - t81
    t83 = t82 * t82
    t84 = t64 + t83
    t85 = sqrt(t84)
    t163 = t85 - t162
    t165 = t163 - i13
    t167 = t165 / i12
    w[20] = t167


ADDRESSES = {
    "setup": law(setup, "ba634eb69663f6da"),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "ba634eb69663f6da"),
}
ADDRESSES["near"] = ADDRESSES["full"]
