"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import cos, sin, sqrt

from delta_calibration.model.jit import idle, law

LAYOUT = ((('q', 3), ('g', 12), ('c', 0)), 3, ('g', 'c'), (), (), ())
SIZE = 35
SHARED = (35, 35)


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
    t39 = t8 * t38
    t40 = cos(i12)
    t41 = i11 * t40
    t42 = t41 - t3
    w[26] = t42
    t43 = t14 * t42
    t44 = t39 - t43
    w[27] = t44
    t45 = t38 * t44
    w[28] = t45
    t56 = t42 * t42
    t57 = t38 * t38
    t58 = t56 + t57
    w[29] = t58
    t63 = i14 * i14
    w[30] = t63
    t67 = t44 * t14
    w[31] = t67
    t77 = t44 * t44
    w[32] = t77
    t83 = t42 * t44
    w[33] = t83
    t86 = t44 * t8
    w[34] = t86


def full(w):
    i9 = w[9]
    i1 = w[1]
    i5 = w[5]
    i0 = w[0]
    t16 = w[22]
    t27 = w[23]
    t30 = w[24]
    i13 = w[13]
    i2 = w[2]
    t42 = w[26]
    t8 = w[19]
    t45 = w[28]
    t58 = w[29]
    t63 = w[30]
    t67 = w[31]
    t14 = w[21]
    t38 = w[25]
    t77 = w[32]
    t3 = w[18]
    t83 = w[33]
    t86 = w[34]
    t13 = w[20]
    t44 = w[27]
    t19 = i9 - i1
    t22 = i5 - i0
    t23 = t19 - t22
    t24 = t23 * t23
    t25 = t16 + t24
    t28 = t25 + t27
    t31 = t28 - t30
    t33 = t31 / 2.0
    t48 = i13 - i2
    t49 = t48 - t22
    t50 = t23 * t42
    t51 = t8 * t49
    t52 = t50 - t51
    t53 = t49 * t52
    t54 = t45 - t53
    t55 = t33 * t54
    t59 = t49 * t49
    t60 = t58 + t59
    t61 = t60 + t27
    t64 = t61 - t63
    t65 = t64 / 2.0
    t66 = t52 * t23
    t68 = t66 - t67
    t69 = t65 * t68
    t70 = t55 + t69
    t71 = t14 * t49
    t72 = t23 * t38
    t73 = t71 - t72
    t74 = t73 * t73
    t75 = t52 * t52
    t76 = t74 + t75
    t78 = t76 + t77
    t79 = t70 / t78
    t80 = t3 + t79
    t81 = t79 * t79
    t82 = t49 * t73
    t84 = t82 - t83
    t85 = t33 * t84
    t87 = t73 * t23
    t88 = t86 - t87
    t89 = t65 * t88
    t90 = t85 + t89
    t91 = t90 / t78
    t92 = t91 * t91
    t93 = t81 + t92
    t94 = t42 * t52
    t95 = t38 * t73
    t96 = t94 - t95
    t97 = t33 * t96
    t98 = t73 * t14
    t99 = t52 * t8
    t100 = t98 - t99
    t101 = t65 * t100
    t102 = t97 + t101
    t103 = t102 / t78
    t104 = t103 * t103
    t105 = t93 + t104
    t106 = t27 - t105
    t107 = t106 / t78
    t108 = sqrt(t107)
    t109 = t108 * t73
    t110 = t80 - t109
    t112 = t13 + t91
    t113 = t108 * t52
    t114 = t112 - t113
    t116 = t22 + t103
    t117 = t108 * t44
    t118 = t116 - t117
    w[15] = t110
    w[16] = t114
    w[17] = t118


ADDRESSES = {
    "setup": law(setup, "d4174b7f15f5ae74"),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "d4174b7f15f5ae74"),
}
ADDRESSES["near"] = ADDRESSES["full"]
