"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import cos, sin

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 2), ('v', 7), ('c', 6)), 2, (), (), (), ('v',))
SIZE = 31
SHARED = (31, 31)


def full(w):
    i11 = w[11]
    i0 = w[0]
    i13 = w[13]
    i9 = w[9]
    i3 = w[3]
    i2 = w[2]
    i12 = w[12]
    i1 = w[1]
    i14 = w[14]
    i10 = w[10]
    i4 = w[4]
    i5 = w[5]
    i6 = w[6]
    i7 = w[7]
    i8 = w[8]
    t3 = i11 * i0
    t5 = t3 + i13
    t6 = sin(t5)
    t8 = sin(i9)
    t9 = t6 * t8
    t10 = i3 * t9
    t12 = cos(t5)
    t13 = t12 * t8
    t14 = i2 * t13
    t15 = t10 - t14
    t19 = i12 * i1
    t21 = t19 + i14
    t22 = cos(t21)
    t23 = t22 * t12
    t24 = sin(t21)
    t26 = cos(i10)
    t27 = t26 * t6
    t28 = t24 * t27
    t29 = t23 - t28
    t30 = t29 * t8
    t31 = i4 * t30
    t32 = t15 - t31
    t34 = t22 * t27
    t35 = t24 * t12
    t36 = t34 + t35
    t37 = t36 * t8
    t38 = i5 * t37
    t39 = t32 + t38
    t41 = sin(i10)
    t42 = t41 * t6
    t43 = t42 * t8
    t44 = i6 * t43
    t45 = t39 - t44
    t46 = i11 * t45
    t49 = t26 * t8
    t50 = cos(i9)
    t51 = t12 * t50
    t52 = t41 * t51
    t53 = t49 + t52
    t54 = t29 * t53
    t55 = t6 * t50
    t56 = t22 * t55
    t57 = t26 * t51
    t58 = t41 * t8
    t59 = t57 - t58
    t60 = t24 * t59
    t61 = t56 + t60
    t62 = t61 * t42
    t63 = t54 + t62
    t64 = i7 * t63
    t66 = t22 * t59
    t67 = t24 * t55
    t68 = t66 - t67
    t69 = t68 * t42
    t70 = t36 * t53
    t71 = t69 - t70
    t72 = i8 * t71
    t73 = t64 + t72
    t74 = i12 * t73
    t75 = -(t74)
    t77 = i11 * t13
    t78 = -(t77)
    t80 = i11 * t9
    t82 = i11 * t30
    t83 = -(t82)
    t85 = i11 * t37
    t87 = i11 * t43
    t88 = -(t87)
    t90 = i12 * t63
    t91 = -(t90)
    t93 = i12 * t71
    t94 = -(t93)
    w[15] = t46
    w[16] = t75
    w[17] = t78
    w[18] = t80
    w[19] = t83
    w[20] = t85
    w[21] = t88
    w[29] = t91
    w[30] = t94


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "a4f94e595a561bf0"),
}
ADDRESSES["near"] = ADDRESSES["full"]
