"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import acos, atan2, floor, sqrt

from delta_calibration.model.jit import idle, law

LAYOUT = ((('x', 3), ('g', 8), ('c', 2)), 1, ('g', 'c'), (), (), ())
SIZE = 23
SHARED = (23, 23)


def setup(w):
    i6 = w[6]
    i7 = w[7]
    i9 = w[9]
    i10 = w[10]
    t2 = i6 * i6
    t4 = i7 * i7
    t5 = t2 + t4
    t12 = 1.1470745597729725e-11 * t5
    t13 = 2.08767569878681e-09 - t12
    t14 = t5 * t13
    t15 = 2.755731922398589e-07 - t14
    t16 = t5 * t15
    t17 = 2.48015873015873e-05 - t16
    t18 = t5 * t17
    t19 = 0.001388888888888889 - t18
    t20 = t5 * t19
    t21 = 0.041666666666666664 - t20
    t22 = t5 * t21
    t23 = 0.5 - t22
    t24 = i7 * i6
    t25 = t23 * t24
    w[14] = t25
    t43 = 1.6059043836821613e-10 * t5
    t44 = 2.505210838544172e-08 - t43
    t45 = t5 * t44
    t46 = 2.7557319223985893e-06 - t45
    t47 = t5 * t46
    t48 = 0.0001984126984126984 - t47
    t49 = t5 * t48
    t50 = 0.008333333333333333 - t49
    t51 = t5 * t50
    t52 = 0.16666666666666666 - t51
    t53 = t5 * t52
    t54 = 1.0 - t53
    t55 = t54 * i6
    w[15] = t55
    t63 = t23 * t2
    t64 = 1.0 - t63
    w[16] = t64
    t71 = t23 * t4
    t72 = 1.0 - t71
    w[17] = t72
    t74 = t54 * i7
    w[18] = t74
    t77 = i6 * i7
    t78 = t23 * t77
    w[19] = t78
    t83 = t4 + t2
    t84 = t23 * t83
    t85 = 1.0 - t84
    w[20] = t85
    t96 = i9 * i9
    w[21] = t96
    t99 = i10 * i10
    w[22] = t99


def full(w):
    i11 = w[11]
    i0 = w[0]
    i12 = w[12]
    i1 = w[1]
    i3 = w[3]
    t25 = w[14]
    i4 = w[4]
    t55 = w[15]
    i2 = w[2]
    i5 = w[5]
    t64 = w[16]
    t72 = w[17]
    t74 = w[18]
    t78 = w[19]
    t85 = w[20]
    t96 = w[21]
    t99 = w[22]
    i9 = w[9]
    i8 = w[8]
    t28 = i11 * i0
    t31 = i12 * i1
    t32 = t28 + t31
    t34 = t32 - i3
    t35 = t25 * t34
    t56 = i11 * i1
    t57 = i12 * i0
    t58 = t56 - t57
    t60 = t58 - i4
    t61 = t55 * t60
    t62 = t35 - t61
    t67 = i2 - i5
    t68 = t64 * t67
    t69 = t62 + t68
    t70 = -(t69)
    t73 = t72 * t34
    t75 = t74 * t60
    t76 = t73 + t75
    t79 = t78 * t67
    t80 = t76 + t79
    t81 = atan2(t70, t80)
    t82 = t80 * t80
    t86 = t85 * t60
    t87 = t74 * t34
    t88 = t86 - t87
    t89 = t55 * t67
    t90 = t88 + t89
    t91 = t90 * t90
    t92 = t82 + t91
    t93 = t69 * t69
    t94 = t92 + t93
    t97 = t94 + t96
    t100 = t97 - t99
    t102 = t100 / 2.0
    t103 = t82 + t93
    t104 = sqrt(t103)
    t105 = i9 * t104
    t106 = t102 / t105
    t107 = acos(t106)
    t108 = t81 - t107
    t110 = t108 - i8
    t113 = 3.141592653589793 - t110
    t114 = t113 / 6.283185307179586
    t115 = floor(t114)
    t116 = 6.283185307179586 * t115
    t117 = t110 + t116
    w[13] = t117


ADDRESSES = {
    "setup": law(setup, "5b354c00b57bd5e2"),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "5b354c00b57bd5e2"),
}
ADDRESSES["near"] = ADDRESSES["full"]
