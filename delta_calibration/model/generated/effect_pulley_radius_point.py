"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import atan2, sqrt

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 10), ('v', 1), ('c', 5)), 1, (), (), (), ('v',))
SIZE = 18
SHARED = (18, 18)


def full(w):
    i3 = w[3]
    i6 = w[6]
    i4 = w[4]
    i7 = w[7]
    i10 = w[10]
    i5 = w[5]
    i8 = w[8]
    i13 = w[13]
    i14 = w[14]
    i15 = w[15]
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
    t30 = i13 - i6
    t31 = t30 * t30
    t33 = i14 - i7
    t34 = t33 * t33
    t35 = t31 + t34
    t36 = sqrt(t35)
    t37 = t36 - i10
    t39 = i15 - i8
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
    t55 = t53 / i9
    t56 = -(t55)
    t58 = t21 / t18
    t59 = i10 / t18
    t60 = 2.0 * t11
    t61 = 2.0 * i10
    t62 = t60 + t61
    t63 = 2.0 * t21
    t64 = t62 / t63
    t65 = t59 * t64
    t66 = t58 + t65
    t67 = t14 / t18
    t68 = t66 - t67
    t69 = i10 * t68
    t70 = t23 + t69
    t71 = t70 - t64
    t72 = t45 / t43
    t73 = i10 / t43
    t74 = 2.0 * t37
    t75 = t74 + t61
    t76 = 2.0 * t45
    t77 = t75 / t76
    t78 = t73 * t77
    t79 = t72 + t78
    t80 = t39 / t43
    t81 = t79 - t80
    t82 = i10 * t81
    t83 = t47 + t82
    t84 = t83 - t77
    t85 = t71 - t84
    t86 = t85 / i9
    t87 = -(t86)
    w[16] = t56
    w[17] = t87


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "e299df8d5f1d16eb"),
}
ADDRESSES["near"] = ADDRESSES["full"]
