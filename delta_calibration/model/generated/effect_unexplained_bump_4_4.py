"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 5), ('v', 4), ('c', 18)), 4, (), (), (), ('v',))
SIZE = 47
SHARED = (47, 47)


def full(w):
    i14 = w[14]
    i4 = w[4]
    i0 = w[0]
    i9 = w[9]
    i1 = w[1]
    i10 = w[10]
    i2 = w[2]
    i11 = w[11]
    i3 = w[3]
    i12 = w[12]
    i13 = w[13]
    i15 = w[15]
    i19 = w[19]
    i23 = w[23]
    i16 = w[16]
    i20 = w[20]
    i24 = w[24]
    i17 = w[17]
    i21 = w[21]
    i25 = w[25]
    i18 = w[18]
    i22 = w[22]
    i26 = w[26]
    i5 = w[5]
    i6 = w[6]
    i7 = w[7]
    i8 = w[8]
    t3 = 1.0 if 0.0 < i14 else 0.0
    t5 = i4 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t12 = i0 - i9
    t13 = t12 * t12
    t16 = i1 - i10
    t17 = t16 * t16
    t18 = t13 + t17
    t21 = i2 - i11
    t22 = t21 * t21
    t23 = t18 + t22
    t26 = i3 - i12
    t27 = t26 * t26
    t28 = t23 + t27
    t30 = t28 * i13
    t32 = i15 - i0
    t34 = i0 - i19
    t35 = max(t32, t34)
    t36 = max(t35, 0.0)
    t38 = t36 * i23
    t39 = t38 * t38
    t41 = i16 - i1
    t43 = i1 - i20
    t44 = max(t41, t43)
    t45 = max(t44, 0.0)
    t47 = t45 * i24
    t48 = t47 * t47
    t49 = t39 + t48
    t51 = i17 - i2
    t53 = i2 - i21
    t54 = max(t51, t53)
    t55 = max(t54, 0.0)
    t57 = t55 * i25
    t58 = t57 * t57
    t59 = t49 + t58
    t61 = i18 - i3
    t63 = i3 - i22
    t64 = max(t61, t63)
    t65 = max(t64, 0.0)
    t67 = t65 * i26
    t68 = t67 * t67
    t69 = t59 + t68
    t70 = t30 + t69
    t71 = -(t70)
    t72 = exp(t71)
    t73 = t9 * t72
    t74 = i5 * t73
    t77 = i6 * t73
    t80 = i7 * t73
    t83 = i8 * t73
    w[27] = t74
    w[28] = t77
    w[29] = t80
    w[30] = t83
    w[31] = t73
    w[36] = t73
    w[41] = t73
    w[46] = t73


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "aa27ead9a14f92f5"),
}
ADDRESSES["near"] = ADDRESSES["full"]
