"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import cos, sin

from delta_calibration.model.jit import idle, law

LAYOUT = ((('q', 1), ('x', 4), ('g', 7), ('c', 2)), 1, ('g', 'c'), ('x',), ('x', 'q'), ('g',))
SIZE = 31
SHARED = (29, 31)


def setup(w):
    i11 = w[11]
    t46 = i11 * i11
    w[27] = t46
    t116 = 2.0 * i11
    t117 = -(t116)
    w[28] = t117


def shared(w):
    i3 = w[3]
    t14 = sin(i3)
    w[29] = t14
    t17 = cos(i3)
    w[30] = t17


def near(w):
    i12 = w[12]
    i4 = w[4]
    i5 = w[5]
    i7 = w[7]
    i8 = w[8]
    t14 = w[29]
    t17 = w[30]
    i6 = w[6]
    i1 = w[1]
    i9 = w[9]
    i2 = w[2]
    i0 = w[0]
    i10 = w[10]
    t46 = w[27]
    t2 = i12 * i4
    t3 = cos(t2)
    t5 = t3 * i5
    t6 = sin(t2)
    t8 = t6 * i7
    t9 = t5 + t8
    t11 = t9 - i8
    t12 = t11 * t11
    t15 = t14 * t6
    t16 = t15 * i5
    t19 = t17 * i6
    t20 = t16 + t19
    t21 = t14 * t3
    t22 = t21 * i7
    t23 = t20 - t22
    t25 = t23 + i1
    t27 = t25 - i9
    t28 = t27 * t27
    t29 = t12 + t28
    t30 = t14 * i6
    t31 = t17 * t6
    t32 = t31 * i5
    t33 = t30 - t32
    t34 = t17 * t3
    t35 = t34 * i7
    t36 = t33 + t35
    t39 = i2 - i0
    t40 = t36 + t39
    t42 = t40 - i10
    t43 = t42 * t42
    t44 = t29 + t43
    t47 = t44 - t46
    t49 = 2.0 * t27
    t51 = 2.0 * t42
    t53 = t6 * t17
    t54 = i5 * t53
    t55 = i6 * t14
    t56 = t54 - t55
    t57 = t3 * t17
    t58 = i7 * t57
    t59 = t56 - t58
    t60 = t49 * t59
    t61 = i6 * t17
    t62 = t6 * t14
    t63 = i5 * t62
    t64 = t61 + t63
    t65 = t3 * t14
    t66 = i7 * t65
    t67 = t64 - t66
    t68 = t51 * t67
    t69 = t60 + t68
    t71 = 2.0 * t11
    t72 = t3 * i12
    t73 = i7 * t72
    t74 = t6 * i12
    t75 = i5 * t74
    t76 = t73 - t75
    t77 = t71 * t76
    t78 = t14 * t72
    t79 = i5 * t78
    t80 = t14 * t74
    t81 = i7 * t80
    t82 = t79 + t81
    t83 = t49 * t82
    t84 = t77 + t83
    t85 = t17 * t72
    t86 = i5 * t85
    t87 = t17 * t74
    t88 = i7 * t87
    t89 = t86 + t88
    t90 = t51 * t89
    t91 = t84 - t90
    t93 = -(t51)
    w[14] = t47
    w[15] = t49
    w[16] = t51
    w[17] = t69
    w[18] = t91
    w[19] = t93


def full(w):
    i12 = w[12]
    i4 = w[4]
    i5 = w[5]
    i7 = w[7]
    i8 = w[8]
    t14 = w[29]
    t17 = w[30]
    i6 = w[6]
    i1 = w[1]
    i9 = w[9]
    i2 = w[2]
    i0 = w[0]
    i10 = w[10]
    t46 = w[27]
    t117 = w[28]
    t2 = i12 * i4
    t3 = cos(t2)
    t5 = t3 * i5
    t6 = sin(t2)
    t8 = t6 * i7
    t9 = t5 + t8
    t11 = t9 - i8
    t12 = t11 * t11
    t15 = t14 * t6
    t16 = t15 * i5
    t19 = t17 * i6
    t20 = t16 + t19
    t21 = t14 * t3
    t22 = t21 * i7
    t23 = t20 - t22
    t25 = t23 + i1
    t27 = t25 - i9
    t28 = t27 * t27
    t29 = t12 + t28
    t30 = t14 * i6
    t31 = t17 * t6
    t32 = t31 * i5
    t33 = t30 - t32
    t34 = t17 * t3
    t35 = t34 * i7
    t36 = t33 + t35
    t39 = i2 - i0
    t40 = t36 + t39
    t42 = t40 - i10
    t43 = t42 * t42
    t44 = t29 + t43
    t47 = t44 - t46
    t49 = 2.0 * t27
    t51 = 2.0 * t42
    t53 = t6 * t17
    t54 = i5 * t53
    t55 = i6 * t14
    t56 = t54 - t55
    t57 = t3 * t17
    t58 = i7 * t57
    t59 = t56 - t58
    t60 = t49 * t59
    t61 = i6 * t17
    t62 = t6 * t14
    t63 = i5 * t62
    t64 = t61 + t63
    t65 = t3 * t14
    t66 = i7 * t65
    t67 = t64 - t66
    t68 = t51 * t67
    t69 = t60 + t68
    t71 = 2.0 * t11
    t72 = t3 * i12
    t73 = i7 * t72
    t74 = t6 * i12
    t75 = i5 * t74
    t76 = t73 - t75
    t77 = t71 * t76
    t78 = t14 * t72
    t79 = i5 * t78
    t80 = t14 * t74
    t81 = i7 * t80
    t82 = t79 + t81
    t83 = t49 * t82
    t84 = t77 + t83
    t85 = t17 * t72
    t86 = i5 * t85
    t87 = t17 * t74
    t88 = i7 * t87
    t89 = t86 + t88
    t90 = t51 * t89
    t91 = t84 - t90
    t93 = -(t51)
    t95 = t71 * t3
    t96 = t49 * t15
    t97 = t95 + t96
    t98 = t51 * t31
    t99 = t97 - t98
    t101 = t49 * t17
    t102 = t51 * t14
    t103 = t101 + t102
    t105 = t71 * t6
    t106 = t49 * t21
    t107 = t105 - t106
    t108 = t51 * t34
    t109 = t107 + t108
    t111 = -(t71)
    t113 = -(t49)
    w[14] = t47
    w[15] = t49
    w[16] = t51
    w[17] = t69
    w[18] = t91
    w[19] = t93
    w[20] = t99
    w[21] = t103
    w[22] = t109
    w[23] = t111
    w[24] = t113
    w[25] = t93
    w[26] = t117


ADDRESSES = {
    "setup": law(setup, "363734c1ee776bb0"),
    "shared": law(shared, "363734c1ee776bb0"),
    "near": law(near, "363734c1ee776bb0"),
    "full": law(full, "363734c1ee776bb0"),
}
