"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import cos, exp, sin, tanh

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 3), ('v', 1), ('c', 8)), 1, (), (), (), ('v',))
SIZE = 14
SHARED = (14, 14)


def full(w):
    i3 = w[3]
    i11 = w[11]
    i6 = w[6]
    i4 = w[4]
    i0 = w[0]
    i5 = w[5]
    i1 = w[1]
    i7 = w[7]
    i8 = w[8]
    i9 = w[9]
    i2 = w[2]
    i10 = w[10]
    t2 = i3 * i11
    t5 = 1.0 if i6 == 1.0 else 0.0
    t8 = i4 * i0
    t11 = i5 * i1
    t12 = t8 + t11
    t14 = t12 - i7
    t16 = t14 * i8
    t17 = t16 if t5 != 0.0 else 0.0
    t19 = 1.0 if i6 == 2.0 else 0.0
    t20 = t16 * t16
    t21 = t20 if t19 != 0.0 else 0.0
    t22 = t17 + t21
    t24 = 1.0 if i6 == 3.0 else 0.0
    t25 = t20 * t16
    t26 = t25 if t24 != 0.0 else 0.0
    t27 = t22 + t26
    t29 = 1.0 if i6 == 4.0 else 0.0
    t30 = sin(t16)
    t31 = t30 if t29 != 0.0 else 0.0
    t32 = t27 + t31
    t34 = 1.0 if i6 == 5.0 else 0.0
    t35 = cos(t16)
    t36 = t35 if t34 != 0.0 else 0.0
    t37 = t32 + t36
    t39 = 1.0 if i6 == 6.0 else 0.0
    t40 = (1.0 if t16 > 0.0 else 0.0) - (1.0 if t16 < 0.0 else 0.0)
    t41 = t40 if t39 != 0.0 else 0.0
    t42 = t37 + t41
    t44 = 1.0 if i6 == 7.0 else 0.0
    t45 = tanh(t16)
    t46 = t45 if t44 != 0.0 else 0.0
    t47 = t42 + t46
    t49 = 1.0 if i6 == 8.0 else 0.0
    t51 = max(t16, 0.0)
    t52 = t51 if t49 != 0.0 else 0.0
    t53 = t47 + t52
    t55 = 1.0 if i6 == 9.0 else 0.0
    t56 = -(t51)
    t57 = exp(t56)
    t58 = 1.0 - t57
    t59 = t58 if t55 != 0.0 else 0.0
    t60 = t53 + t59
    t62 = 1.0 if i6 == 10.0 else 0.0
    t63 = abs(t16)
    t64 = t16 * t63
    t65 = t64 if t62 != 0.0 else 0.0
    t66 = t60 + t65
    t68 = 1.0 if i6 == 11.0 else 0.0
    t69 = t57 if t68 != 0.0 else 0.0
    t70 = t66 + t69
    t72 = 1.0 if i6 == 12.0 else 0.0
    t73 = min(t51, 1.0)
    t74 = t73 if t72 != 0.0 else 0.0
    t75 = t70 + t74
    t77 = 1.0 if i6 == 13.0 else 0.0
    t78 = t16 if t77 != 0.0 else 0.0
    t79 = t75 + t78
    t81 = 1.0 if i6 == 14.0 else 0.0
    t82 = 1.0 if t81 != 0.0 else 0.0
    t83 = t79 + t82
    t84 = t2 * t83
    t86 = 1.0 if 0.0 < i9 else 0.0
    t89 = i2 - i10
    t90 = t89 if t86 != 0.0 else 0.0
    t91 = 0.0 if t86 != 0.0 else 1.0
    t92 = 1.0 if t91 != 0.0 else 0.0
    t93 = t90 + t92
    t94 = t84 * t93
    t96 = t83 * i11
    t97 = t93 * t96
    w[12] = t94
    w[13] = t97


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "ae34174f52a20db6"),
}
ADDRESSES["near"] = ADDRESSES["full"]
