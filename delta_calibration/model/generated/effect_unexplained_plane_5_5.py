"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 7), ('v', 5), ('c', 19)), 5, (), (), (), ('v',))
SIZE = 61
SHARED = (61, 61)


def full(w):
    i5 = w[5]
    i12 = w[12]
    i13 = w[13]
    i6 = w[6]
    i14 = w[14]
    i15 = w[15]
    i16 = w[16]
    i0 = w[0]
    i21 = w[21]
    i26 = w[26]
    i17 = w[17]
    i1 = w[1]
    i22 = w[22]
    i27 = w[27]
    i18 = w[18]
    i2 = w[2]
    i23 = w[23]
    i28 = w[28]
    i19 = w[19]
    i3 = w[3]
    i24 = w[24]
    i29 = w[29]
    i20 = w[20]
    i4 = w[4]
    i25 = w[25]
    i30 = w[30]
    i7 = w[7]
    i8 = w[8]
    i9 = w[9]
    i10 = w[10]
    i11 = w[11]
    t3 = i5 - i12
    t5 = t3 * i13
    t8 = i6 - i14
    t10 = t8 * i15
    t11 = t5 * t10
    t14 = i16 - i0
    t16 = i0 - i21
    t17 = max(t14, t16)
    t19 = max(t17, 0.0)
    t21 = t19 * i26
    t22 = t21 * t21
    t25 = i17 - i1
    t27 = i1 - i22
    t28 = max(t25, t27)
    t29 = max(t28, 0.0)
    t31 = t29 * i27
    t32 = t31 * t31
    t33 = t22 + t32
    t36 = i18 - i2
    t38 = i2 - i23
    t39 = max(t36, t38)
    t40 = max(t39, 0.0)
    t42 = t40 * i28
    t43 = t42 * t42
    t44 = t33 + t43
    t47 = i19 - i3
    t49 = i3 - i24
    t50 = max(t47, t49)
    t51 = max(t50, 0.0)
    t53 = t51 * i29
    t54 = t53 * t53
    t55 = t44 + t54
    t58 = i20 - i4
    t60 = i4 - i25
    t61 = max(t58, t60)
    t62 = max(t61, 0.0)
    t64 = t62 * i30
    t65 = t64 * t64
    t66 = t55 + t65
    t67 = -(t66)
    t68 = exp(t67)
    t69 = t11 * t68
    t70 = i7 * t69
    t73 = i8 * t69
    t76 = i9 * t69
    t79 = i10 * t69
    t82 = i11 * t69
    w[31] = t70
    w[32] = t73
    w[33] = t76
    w[34] = t79
    w[35] = t82
    w[36] = t69
    w[42] = t69
    w[48] = t69
    w[54] = t69
    w[60] = t69


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "f43436d16bbf6cb1"),
}
ADDRESSES["near"] = ADDRESSES["full"]
