"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 6), ('v', 1), ('c', 22)), 1, (), (), (), ('v',))
SIZE = 31
SHARED = (31, 31)


def full(w):
    i13 = w[13]
    i5 = w[5]
    i6 = w[6]
    i0 = w[0]
    i7 = w[7]
    i1 = w[1]
    i8 = w[8]
    i2 = w[2]
    i9 = w[9]
    i3 = w[3]
    i10 = w[10]
    i4 = w[4]
    i11 = w[11]
    i12 = w[12]
    i14 = w[14]
    i19 = w[19]
    i24 = w[24]
    i15 = w[15]
    i20 = w[20]
    i25 = w[25]
    i16 = w[16]
    i21 = w[21]
    i26 = w[26]
    i17 = w[17]
    i22 = w[22]
    i27 = w[27]
    i18 = w[18]
    i23 = w[23]
    i28 = w[28]
    t3 = 1.0 if 0.0 < i13 else 0.0
    t5 = i5 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t10 = i6 * t9
    t13 = i0 - i7
    t14 = t13 * t13
    t17 = i1 - i8
    t18 = t17 * t17
    t19 = t14 + t18
    t22 = i2 - i9
    t23 = t22 * t22
    t24 = t19 + t23
    t27 = i3 - i10
    t28 = t27 * t27
    t29 = t24 + t28
    t32 = i4 - i11
    t33 = t32 * t32
    t34 = t29 + t33
    t36 = t34 * i12
    t38 = i14 - i0
    t40 = i0 - i19
    t41 = max(t38, t40)
    t42 = max(t41, 0.0)
    t44 = t42 * i24
    t45 = t44 * t44
    t47 = i15 - i1
    t49 = i1 - i20
    t50 = max(t47, t49)
    t51 = max(t50, 0.0)
    t53 = t51 * i25
    t54 = t53 * t53
    t55 = t45 + t54
    t57 = i16 - i2
    t59 = i2 - i21
    t60 = max(t57, t59)
    t61 = max(t60, 0.0)
    t63 = t61 * i26
    t64 = t63 * t63
    t65 = t55 + t64
    t67 = i17 - i3
    t69 = i3 - i22
    t70 = max(t67, t69)
    t71 = max(t70, 0.0)
    t73 = t71 * i27
    t74 = t73 * t73
    t75 = t65 + t74
    t77 = i18 - i4
    t79 = i4 - i23
    t80 = max(t77, t79)
    t81 = max(t80, 0.0)
    t83 = t81 * i28
    t84 = t83 * t83
    t85 = t75 + t84
    t86 = t36 + t85
    t87 = -(t86)
    t88 = exp(t87)
    t89 = t10 * t88
    t91 = t88 * t9
    w[29] = t89
    w[30] = t91


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "563153e35989d32e"),
}
ADDRESSES["near"] = ADDRESSES["full"]
