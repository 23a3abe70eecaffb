"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import atan2, sqrt

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 10), ('v', 1), ('c', 7)), 1, (), (), (), ('v',))
SIZE = 20
SHARED = (20, 20)


def full(w):
    i3 = w[3]
    i6 = w[6]
    i4 = w[4]
    i7 = w[7]
    i10 = w[10]
    i5 = w[5]
    i8 = w[8]
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
    t14 = i5 - i8
    t15 = atan2(t11, t14)
    t16 = t11 * t11
    t17 = t14 * t14
    t18 = t16 + t17
    t19 = i10 * i10
    t20 = t18 - t19
    t21 = sqrt(t20)
    t22 = atan2(i10, t21)
    t23 = t15 + t22
    t24 = i10 * t23
    t25 = t24 + t21
    t26 = t9 + t17
    t27 = sqrt(t26)
    t28 = t25 - t27
    t30 = i15 - i6
    t31 = t30 * t30
    t33 = i16 - i7
    t34 = t33 * t33
    t35 = t31 + t34
    t36 = sqrt(t35)
    t37 = t36 - i10
    t39 = i17 - i8
    t40 = atan2(t37, t39)
    t41 = t37 * t37
    t42 = t39 * t39
    t43 = t41 + t42
    t44 = t43 - t19
    t45 = sqrt(t44)
    t46 = atan2(i10, t45)
    t47 = t40 + t46
    t48 = i10 * t47
    t49 = t48 + t45
    t50 = t35 + t42
    t51 = sqrt(t50)
    t52 = t49 - t51
    t53 = t28 - t52
    t56 = i13 * i9
    t57 = t53 / t56
    t58 = -(t57)
    t60 = t21 / t18
    t61 = i10 / t18
    t62 = 2.0 * t11
    t63 = 2.0 * i10
    t64 = t62 + t63
    t65 = 2.0 * t21
    t66 = t64 / t65
    t67 = t61 * t66
    t68 = t60 + t67
    t69 = t14 / t18
    t70 = t68 - t69
    t71 = i10 * t70
    t72 = t23 + t71
    t73 = t72 - t66
    t74 = t45 / t43
    t75 = i10 / t43
    t76 = 2.0 * t37
    t77 = t76 + t63
    t78 = 2.0 * t45
    t79 = t77 / t78
    t80 = t75 * t79
    t81 = t74 + t80
    t82 = t39 / t43
    t83 = t81 - t82
    t84 = i10 * t83
    t85 = t47 + t84
    t86 = t85 - t79
    t87 = t73 - t86
    t88 = t87 / t56
    t89 = -(t88)
    w[18] = t58
    w[19] = t89


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "7bed34b3a891d949"),
}
ADDRESSES["near"] = ADDRESSES["full"]
