"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import acos, atan2, floor, sqrt

from delta_calibration.model.jit import idle, law

LAYOUT = ((('x', 6), ('g', 22), ('c', 2)), 1, ('g', 'c'), (), (), ())
SIZE = 43
SHARED = (43, 43)


def setup(w):
    i12 = w[12]
    i13 = w[13]
    i6 = w[6]
    i9 = w[9]
    i7 = w[7]
    i10 = w[10]
    i8 = w[8]
    i11 = w[11]
    i15 = w[15]
    i16 = w[16]
    t2 = i12 * i12
    t4 = i13 * i13
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
    t24 = i13 * i12
    t25 = t23 * t24
    w[31] = t25
    t35 = i6 - i9
    w[32] = t35
    t45 = 1.6059043836821613e-10 * t5
    t46 = 2.505210838544172e-08 - t45
    t47 = t5 * t46
    t48 = 2.7557319223985893e-06 - t47
    t49 = t5 * t48
    t50 = 0.0001984126984126984 - t49
    t51 = t5 * t50
    t52 = 0.008333333333333333 - t51
    t53 = t5 * t52
    t54 = 0.16666666666666666 - t53
    t55 = t5 * t54
    t56 = 1.0 - t55
    t57 = t56 * i12
    w[33] = t57
    t63 = i7 - i10
    w[34] = t63
    t67 = t23 * t2
    t68 = 1.0 - t67
    w[35] = t68
    t72 = i8 - i11
    w[36] = t72
    t77 = t23 * t4
    t78 = 1.0 - t77
    w[37] = t78
    t80 = t56 * i13
    w[38] = t80
    t83 = i12 * i13
    t84 = t23 * t83
    w[39] = t84
    t89 = t4 + t2
    t90 = t23 * t89
    t91 = 1.0 - t90
    w[40] = t91
    t102 = i15 * i15
    w[41] = t102
    t105 = i16 * i16
    w[42] = t105


def full(w):
    i28 = w[28]
    i0 = w[0]
    i29 = w[29]
    i1 = w[1]
    t35 = w[32]
    t25 = w[31]
    t63 = w[34]
    t57 = w[33]
    i2 = w[2]
    t72 = w[36]
    t68 = w[35]
    t78 = w[37]
    t80 = w[38]
    t84 = w[39]
    t91 = w[40]
    t102 = w[41]
    t105 = w[42]
    i15 = w[15]
    i14 = w[14]
    t28 = i28 * i0
    t31 = i29 * i1
    t32 = t28 + t31
    t36 = t32 - t35
    t37 = t25 * t36
    t58 = i28 * i1
    t59 = i29 * i0
    t60 = t58 - t59
    t64 = t60 - t63
    t65 = t57 * t64
    t66 = t37 - t65
    t73 = i2 - t72
    t74 = t68 * t73
    t75 = t66 + t74
    t76 = -(t75)
    t79 = t78 * t36
    t81 = t80 * t64
    t82 = t79 + t81
    t85 = t84 * t73
    t86 = t82 + t85
    t87 = atan2(t76, t86)
    t88 = t86 * t86
    t92 = t91 * t64
    t93 = t80 * t36
    t94 = t92 - t93
    t95 = t57 * t73
    t96 = t94 + t95
    t97 = t96 * t96
    t98 = t88 + t97
    t99 = t75 * t75
    t100 = t98 + t99
    t103 = t100 + t102
    t106 = t103 - t105
    t108 = t106 / 2.0
    t109 = t88 + t99
    t110 = sqrt(t109)
    t111 = i15 * t110
    t112 = t108 / t111
    t113 = acos(t112)
    t114 = t87 - t113
    t116 = t114 - i14
    t119 = 3.141592653589793 - t116
    t120 = t119 / 6.283185307179586
    t121 = floor(t120)
    t122 = 6.283185307179586 * t121
    t123 = t116 + t122
    w[30] = t123


ADDRESSES = {
    "setup": law(setup, "55af1cfd5fc707dc"),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "55af1cfd5fc707dc"),
}
ADDRESSES["near"] = ADDRESSES["full"]
