"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import cos, sin, sqrt

from delta_calibration.model.jit import idle, law

LAYOUT = ((('q', 1), ('x', 3), ('g', 6), ('c', 0)), 1, ('g', 'c'), ('x',), ('x', 'q'), ('g',))
SIZE = 38
SHARED = (38, 38)


def setup(w):
    i5 = w[5]
    i4 = w[4]
    i8 = w[8]
    i9 = w[9]
    i7 = w[7]
    t3 = cos(i5)
    w[21] = t3
    t4 = i4 * t3
    w[22] = t4
    t7 = t3 * i8
    t8 = sin(i5)
    w[23] = t8
    t10 = t8 * i9
    t11 = t7 - t10
    t13 = i8 * i8
    t14 = 1.0 + t13
    t15 = i9 * i9
    t16 = t14 + t15
    t17 = sqrt(t16)
    w[24] = t17
    t18 = t11 / t17
    w[25] = t18
    t24 = i4 * t8
    w[26] = t24
    t25 = t8 * i8
    t26 = t3 * i9
    t27 = t25 + t26
    t28 = t27 / t17
    w[27] = t28
    t42 = i7 * i7
    w[28] = t42
    t62 = i8 * t8
    t63 = i9 * t3
    t64 = t62 + t63
    t65 = t64 / t17
    w[29] = t65
    t69 = i8 * t3
    t70 = i9 * t8
    t71 = t69 - t70
    t72 = t71 / t17
    w[30] = t72
    t81 = 2.0 * i7
    t82 = -(t81)
    w[31] = t82
    t84 = t3 / t17
    t85 = t18 / t17
    t86 = i8 / t17
    w[32] = t86
    t87 = t85 * t86
    t88 = t84 - t87
    w[33] = t88
    t91 = t8 / t17
    t92 = t28 / t17
    t93 = t92 * t86
    t94 = t91 - t93
    w[34] = t94
    t103 = i9 / t17
    w[35] = t103
    t104 = t92 * t103
    t105 = t84 - t104
    w[36] = t105
    t108 = t85 * t103
    t109 = t91 + t108
    w[37] = t109


def near(w):
    i0 = w[0]
    t18 = w[25]
    t4 = w[22]
    i1 = w[1]
    t28 = w[27]
    t24 = w[26]
    i2 = w[2]
    t17 = w[24]
    i6 = w[6]
    i3 = w[3]
    t42 = w[28]
    t19 = i0 * t18
    t20 = t4 - t19
    t21 = i1 - t20
    t22 = t21 * t21
    t29 = i0 * t28
    t30 = t24 - t29
    t31 = i2 - t30
    t32 = t31 * t31
    t33 = t22 + t32
    t36 = i0 / t17
    t37 = i6 - t36
    t38 = i3 - t37
    t39 = t38 * t38
    t40 = t33 + t39
    t43 = t40 - t42
    t45 = 2.0 * t21
    t47 = 2.0 * t31
    t49 = 2.0 * t38
    t51 = t45 * t18
    t52 = t47 * t28
    t53 = t51 + t52
    t54 = t49 / t17
    t55 = t53 + t54
    w[10] = t43
    w[11] = t45
    w[12] = t47
    w[13] = t49
    w[14] = t55


def full(w):
    i0 = w[0]
    t18 = w[25]
    t4 = w[22]
    i1 = w[1]
    t28 = w[27]
    t24 = w[26]
    i2 = w[2]
    t17 = w[24]
    i6 = w[6]
    i3 = w[3]
    t42 = w[28]
    t3 = w[21]
    t8 = w[23]
    t65 = w[29]
    t72 = w[30]
    t88 = w[33]
    t94 = w[34]
    t86 = w[32]
    t105 = w[36]
    t109 = w[37]
    t103 = w[35]
    t82 = w[31]
    t19 = i0 * t18
    t20 = t4 - t19
    t21 = i1 - t20
    t22 = t21 * t21
    t29 = i0 * t28
    t30 = t24 - t29
    t31 = i2 - t30
    t32 = t31 * t31
    t33 = t22 + t32
    t36 = i0 / t17
    t37 = i6 - t36
    t38 = i3 - t37
    t39 = t38 * t38
    t40 = t33 + t39
    t43 = t40 - t42
    t45 = 2.0 * t21
    t47 = 2.0 * t31
    t49 = 2.0 * t38
    t51 = t45 * t18
    t52 = t47 * t28
    t53 = t51 + t52
    t54 = t49 / t17
    t55 = t53 + t54
    t57 = t45 * t3
    t58 = t47 * t8
    t59 = t57 + t58
    t60 = -(t59)
    t66 = i0 * t65
    t67 = t66 - t24
    t68 = t45 * t67
    t73 = i0 * t72
    t74 = t4 - t73
    t75 = t47 * t74
    t76 = t68 + t75
    t77 = -(t76)
    t79 = -(t49)
    t89 = i0 * t88
    t90 = t45 * t89
    t95 = i0 * t94
    t96 = t47 * t95
    t97 = t90 + t96
    t98 = t36 / t17
    t99 = t98 * t86
    t100 = t49 * t99
    t101 = t97 - t100
    t106 = i0 * t105
    t107 = t47 * t106
    t110 = i0 * t109
    t111 = t45 * t110
    t112 = t107 - t111
    t113 = t98 * t103
    t114 = t49 * t113
    t115 = t112 - t114
    w[10] = t43
    w[11] = t45
    w[12] = t47
    w[13] = t49
    w[14] = t55
    w[15] = t60
    w[16] = t77
    w[17] = t79
    w[18] = t82
    w[19] = t101
    w[20] = t115


ADDRESSES = {
    "setup": law(setup, "1bb7352b44b940b6"),
    "shared": idle(),
    "near": law(near, "1bb7352b44b940b6"),
    "full": law(full, "1bb7352b44b940b6"),
}
