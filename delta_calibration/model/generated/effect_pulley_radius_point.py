"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import atan2, sqrt

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 10), ('v', 1), ('c', 8)), 1, (), (), (), ('v',))
SIZE = 21
SHARED = (21, 21)


def full(w):
    i3 = w[3]
    i6 = w[6]
    i4 = w[4]
    i7 = w[7]
    i10 = w[10]
    i5 = w[5]
    i8 = w[8]
    i18 = w[18]
    i15 = w[15]
    i16 = w[16]
    i17 = w[17]
    i13 = w[13]
    i9 = w[9]
    t3 = i3 - i6
    t4 = t3 * t3
    t7 = i4 - i7
    t8 = t7 * t7
    t9 = t4 + t8
    t10 = sqrt(t9)
    t11 = t10 - i10
    t15 = i5 - i8
    t16 = i18 * t15
    t17 = atan2(t11, t16)
    t18 = t11 * t11
    t19 = t16 * t16
    t20 = t18 + t19
    t21 = i10 * i10
    t22 = t20 - t21
    t23 = sqrt(t22)
    t24 = atan2(i10, t23)
    t25 = t17 + t24
    t26 = i10 * t25
    t27 = t26 + t23
    t28 = t15 * t15
    t29 = t9 + t28
    t30 = sqrt(t29)
    t31 = t27 - t30
    t33 = i15 - i6
    t34 = t33 * t33
    t36 = i16 - i7
    t37 = t36 * t36
    t38 = t34 + t37
    t39 = sqrt(t38)
    t40 = t39 - i10
    t42 = i17 - i8
    t43 = i18 * t42
    t44 = atan2(t40, t43)
    t45 = t40 * t40
    t46 = t43 * t43
    t47 = t45 + t46
    t48 = t47 - t21
    t49 = sqrt(t48)
    t50 = atan2(i10, t49)
    t51 = t44 + t50
    t52 = i10 * t51
    t53 = t52 + t49
    t54 = t42 * t42
    t55 = t38 + t54
    t56 = sqrt(t55)
    t57 = t53 - t56
    t58 = t31 - t57
    t61 = i13 * i9
    t62 = t58 / t61
    t63 = -(t62)
    t65 = t23 / t20
    t66 = i10 / t20
    t67 = 2.0 * t11
    t68 = 2.0 * i10
    t69 = t67 + t68
    t70 = 2.0 * t23
    t71 = t69 / t70
    t72 = t66 * t71
    t73 = t65 + t72
    t74 = t16 / t20
    t75 = t73 - t74
    t76 = i10 * t75
    t77 = t25 + t76
    t78 = t77 - t71
    t79 = t49 / t47
    t80 = i10 / t47
    t81 = 2.0 * t40
    t82 = t81 + t68
    t83 = 2.0 * t49
    t84 = t82 / t83
    t85 = t80 * t84
    t86 = t79 + t85
    t87 = t43 / t47
    t88 = t86 - t87
    t89 = i10 * t88
    t90 = t51 + t89
    t91 = t90 - t84
    t92 = t78 - t91
    t93 = t92 / t61
    t94 = -(t93)
    w[19] = t63
    w[20] = t94


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "0025af5bd4841353"),
}
ADDRESSES["near"] = ADDRESSES["full"]
