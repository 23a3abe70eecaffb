"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import cos, sin

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 4), ('v', 9), ('c', 6)), 2, (), (), (), ('v',))
SIZE = 39
SHARED = (39, 39)


def full(w):
    i15 = w[15]
    i0 = w[0]
    i17 = w[17]
    i13 = w[13]
    i5 = w[5]
    i4 = w[4]
    i16 = w[16]
    i1 = w[1]
    i18 = w[18]
    i14 = w[14]
    i6 = w[6]
    i7 = w[7]
    i8 = w[8]
    i11 = w[11]
    i2 = w[2]
    i9 = w[9]
    i10 = w[10]
    i12 = w[12]
    i3 = w[3]
    t3 = i15 * i0
    t5 = t3 + i17
    t6 = sin(t5)
    t8 = sin(i13)
    t9 = t6 * t8
    t10 = i5 * t9
    t12 = cos(t5)
    t13 = t12 * t8
    t14 = i4 * t13
    t15 = t10 - t14
    t19 = i16 * i1
    t21 = t19 + i18
    t22 = cos(t21)
    t23 = t22 * t12
    t24 = sin(t21)
    t26 = cos(i14)
    t27 = t26 * t6
    t28 = t24 * t27
    t29 = t23 - t28
    t30 = t29 * t8
    t31 = i6 * t30
    t32 = t15 - t31
    t34 = t22 * t27
    t35 = t24 * t12
    t36 = t34 + t35
    t37 = t36 * t8
    t38 = i7 * t37
    t39 = t32 + t38
    t41 = sin(i14)
    t42 = t41 * t6
    t43 = t42 * t8
    t44 = i8 * t43
    t45 = t39 - t44
    t46 = i15 * t45
    t49 = i11 * i2
    t50 = t46 - t49
    t53 = t26 * t8
    t54 = cos(i13)
    t55 = t12 * t54
    t56 = t41 * t55
    t57 = t53 + t56
    t58 = t29 * t57
    t59 = t6 * t54
    t60 = t22 * t59
    t61 = t26 * t55
    t62 = t41 * t8
    t63 = t61 - t62
    t64 = t24 * t63
    t65 = t60 + t64
    t66 = t65 * t42
    t67 = t58 + t66
    t68 = i9 * t67
    t70 = t22 * t63
    t71 = t24 * t59
    t72 = t70 - t71
    t73 = t72 * t42
    t74 = t36 * t57
    t75 = t73 - t74
    t76 = i10 * t75
    t77 = t68 + t76
    t78 = i16 * t77
    t81 = i12 * i3
    t82 = t78 + t81
    t83 = -(t82)
    t85 = i15 * t13
    t86 = -(t85)
    t88 = i15 * t9
    t90 = i15 * t30
    t91 = -(t90)
    t93 = i15 * t37
    t95 = i15 * t43
    t96 = -(t95)
    t98 = i16 * t67
    t99 = -(t98)
    t101 = i16 * t75
    t102 = -(t101)
    t104 = -(i2)
    t106 = -(i3)
    w[19] = t50
    w[20] = t83
    w[21] = t86
    w[22] = t88
    w[23] = t91
    w[24] = t93
    w[25] = t96
    w[35] = t99
    w[36] = t102
    w[28] = t104
    w[38] = t106


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "4f827dc69654e93f"),
}
ADDRESSES["near"] = ADDRESSES["full"]
