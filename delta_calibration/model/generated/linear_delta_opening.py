"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import cos, sin, sqrt

from delta_calibration.model.jit import idle, law

LAYOUT = ((('q', 3), ('g', 12), ('c', 0)), 3, ('g', 'c'), (), (), ())
SIZE = 32
SHARED = (32, 32)


def setup(w):
    i4 = w[4]
    i3 = w[3]
    i8 = w[8]
    i7 = w[7]
    i6 = w[6]
    i10 = w[10]
    i12 = w[12]
    i11 = w[11]
    i14 = w[14]
    t2 = cos(i4)
    t3 = i3 * t2
    w[18] = t3
    t6 = cos(i8)
    t7 = i7 * t6
    t8 = t7 - t3
    w[19] = t8
    t9 = t8 * t8
    t10 = sin(i8)
    t11 = i7 * t10
    t12 = sin(i4)
    t13 = i3 * t12
    w[20] = t13
    t14 = t11 - t13
    w[21] = t14
    t15 = t14 * t14
    t16 = t9 + t15
    w[22] = t16
    t27 = i6 * i6
    w[23] = t27
    t30 = i10 * i10
    w[24] = t30
    t36 = sin(i12)
    t37 = i11 * t36
    t38 = t37 - t13
    w[25] = t38
    t40 = cos(i12)
    t41 = i11 * t40
    t42 = t41 - t3
    w[26] = t42
    t43 = t42 * t42
    t44 = t38 * t38
    t45 = t43 + t44
    w[27] = t45
    t54 = i14 * i14
    w[28] = t54
    t59 = t8 * t38
    t60 = t14 * t42
    t61 = t59 - t60
    w[29] = t61
    t77 = t61 * t61
    w[30] = t77
    t82 = t6 - t2
    t83 = t36 - t12
    t84 = t82 * t83
    t85 = t10 - t12
    t86 = t40 - t2
    t87 = t85 * t86
    t88 = t84 - t87
    t89 = 1.0 if 0.0 < t88 else 0.0
    t91 = 1.0 if t89 != 0.0 else 0.0
    t92 = 0.0 if t89 != 0.0 else 1.0
    t94 = (-1.0) if t92 != 0.0 else 0.0
    t95 = t91 + t94
    w[31] = t95


def full(w):
    i9 = w[9]
    i1 = w[1]
    i5 = w[5]
    i0 = w[0]
    t16 = w[22]
    t27 = w[23]
    t30 = w[24]
    t38 = w[25]
    i13 = w[13]
    i2 = w[2]
    t45 = w[27]
    t54 = w[28]
    t14 = w[21]
    t61 = w[29]
    t42 = w[26]
    t8 = w[19]
    t77 = w[30]
    t3 = w[18]
    t95 = w[31]
    t13 = w[20]
    t19 = i9 - i1
    t22 = i5 - i0
    t23 = t19 - t22
    t24 = t23 * t23
    t25 = t16 + t24
    t28 = t25 + t27
    t31 = t28 - t30
    t33 = t31 / 2.0
    t39 = t33 * t38
    t48 = i13 - i2
    t49 = t48 - t22
    t50 = t49 * t49
    t51 = t45 + t50
    t52 = t51 + t27
    t55 = t52 - t54
    t56 = t55 / 2.0
    t57 = t56 * t14
    t58 = t39 - t57
    t62 = t58 * t61
    t63 = t33 * t49
    t64 = t56 * t23
    t65 = t63 - t64
    t66 = t23 * t42
    t67 = t8 * t49
    t68 = t66 - t67
    t69 = t65 * t68
    t70 = t62 - t69
    t71 = t14 * t49
    t72 = t23 * t38
    t73 = t71 - t72
    t74 = t73 * t73
    t75 = t68 * t68
    t76 = t74 + t75
    t78 = t76 + t77
    t79 = t70 / t78
    t80 = t3 + t79
    t96 = t79 * t79
    t97 = t65 * t73
    t98 = t33 * t42
    t99 = t56 * t8
    t100 = t98 - t99
    t101 = t100 * t61
    t102 = t97 - t101
    t103 = t102 / t78
    t104 = t103 * t103
    t105 = t96 + t104
    t106 = t100 * t68
    t107 = t58 * t73
    t108 = t106 - t107
    t109 = t108 / t78
    t110 = t109 * t109
    t111 = t105 + t110
    t112 = t27 - t111
    t113 = t112 / t78
    t114 = sqrt(t113)
    t115 = t95 * t114
    t116 = t115 * t73
    t117 = t80 - t116
    t119 = t13 + t103
    t120 = t115 * t68
    t121 = t119 - t120
    t123 = t22 + t109
    t124 = t115 * t61
    t125 = t123 - t124
    w[15] = t117
    w[16] = t121
    w[17] = t125


ADDRESSES = {
    "setup": law(setup, "90ade7550fca10a7"),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "90ade7550fca10a7"),
}
ADDRESSES["near"] = ADDRESSES["full"]
