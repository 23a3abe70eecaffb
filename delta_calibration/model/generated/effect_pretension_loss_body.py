"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import cos, exp, sin, sqrt

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 16), ('v', 1), ('c', 11)), 1, (), (), (), ('v',))
SIZE = 30
SHARED = (30, 30)


def full(w):
    i27 = w[27]
    i2 = w[2]
    i16 = w[16]
    i1 = w[1]
    i6 = w[6]
    i7 = w[7]
    i8 = w[8]
    i12 = w[12]
    i13 = w[13]
    i14 = w[14]
    i3 = w[3]
    i9 = w[9]
    i4 = w[4]
    i10 = w[10]
    i5 = w[5]
    i11 = w[11]
    i19 = w[19]
    i15 = w[15]
    t3 = 1.0 if 0.0 < i27 else 0.0
    t6 = max(i2, 0.0)
    t8 = max(i27, 1e-09)
    t9 = t6 / t8
    t10 = -(t9)
    t11 = exp(t10)
    t12 = 1.0 - t11
    t13 = t12 if t3 != 0.0 else 0.0
    t14 = 0.0 if t3 != 0.0 else 1.0
    t16 = i2 / 3600.0
    t17 = t16 if t14 != 0.0 else 0.0
    t18 = t13 + t17
    t19 = i16 * t18
    t21 = t19 * i1
    t24 = i6 * i6
    t26 = i7 * i7
    t27 = t24 + t26
    t29 = i8 * i8
    t30 = t27 + t29
    t32 = t30 + 1e-300
    t33 = sqrt(t32)
    t35 = t33 / 2.0
    t36 = sin(t35)
    t37 = t36 / t35
    t38 = t37 * t37
    t39 = t38 / 2.0
    t40 = t29 + t26
    t41 = t39 * t40
    t42 = 1.0 - t41
    t44 = t42 * i12
    t45 = i7 * i6
    t46 = t39 * t45
    t47 = cos(t35)
    t48 = t37 * t47
    t49 = t48 * i8
    t50 = t46 - t49
    t52 = t50 * i13
    t53 = t44 + t52
    t54 = t48 * i7
    t55 = i8 * i6
    t56 = t39 * t55
    t57 = t54 + t56
    t59 = t57 * i14
    t60 = t53 + t59
    t61 = i3 + t60
    t63 = t61 - i9
    t64 = t63 * t63
    t66 = i6 * i7
    t67 = t39 * t66
    t68 = t49 + t67
    t69 = t68 * i12
    t70 = t29 + t24
    t71 = t39 * t70
    t72 = 1.0 - t71
    t73 = t72 * i13
    t74 = t69 + t73
    t75 = i8 * i7
    t76 = t39 * t75
    t77 = t48 * i6
    t78 = t76 - t77
    t79 = t78 * i14
    t80 = t74 + t79
    t81 = i4 + t80
    t83 = t81 - i10
    t84 = t83 * t83
    t85 = t64 + t84
    t87 = i6 * i8
    t88 = t39 * t87
    t89 = t88 - t54
    t90 = t89 * i12
    t91 = i7 * i8
    t92 = t39 * t91
    t93 = t77 + t92
    t94 = t93 * i13
    t95 = t90 + t94
    t96 = t26 + t24
    t97 = t39 * t96
    t98 = 1.0 - t97
    t99 = t98 * i14
    t100 = t95 + t99
    t101 = i5 + t100
    t103 = t101 - i11
    t104 = t103 * t103
    t105 = t85 + t104
    t106 = sqrt(t105)
    t107 = t21 * t106
    t110 = i19 * i15
    t111 = t107 / t110
    t112 = -(t111)
    t114 = i1 * t18
    t115 = t106 * t114
    t116 = t115 / t110
    t117 = -(t116)
    w[28] = t112
    w[29] = t117


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "aa19e07e4ceb263d"),
}
ADDRESSES["near"] = ADDRESSES["full"]
