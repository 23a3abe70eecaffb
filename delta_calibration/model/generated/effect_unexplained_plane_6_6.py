"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 8), ('v', 6), ('c', 22)), 6, (), (), (), ('v',))
SIZE = 78
SHARED = (78, 78)


def full(w):
    i6 = w[6]
    i14 = w[14]
    i15 = w[15]
    i7 = w[7]
    i16 = w[16]
    i17 = w[17]
    i18 = w[18]
    i0 = w[0]
    i24 = w[24]
    i30 = w[30]
    i19 = w[19]
    i1 = w[1]
    i25 = w[25]
    i31 = w[31]
    i20 = w[20]
    i2 = w[2]
    i26 = w[26]
    i32 = w[32]
    i21 = w[21]
    i3 = w[3]
    i27 = w[27]
    i33 = w[33]
    i22 = w[22]
    i4 = w[4]
    i28 = w[28]
    i34 = w[34]
    i23 = w[23]
    i5 = w[5]
    i29 = w[29]
    i35 = w[35]
    i8 = w[8]
    i9 = w[9]
    i10 = w[10]
    i11 = w[11]
    i12 = w[12]
    i13 = w[13]
    t3 = i6 - i14
    t5 = t3 * i15
    t8 = i7 - i16
    t10 = t8 * i17
    t11 = t5 * t10
    t14 = i18 - i0
    t16 = i0 - i24
    t17 = max(t14, t16)
    t19 = max(t17, 0.0)
    t21 = t19 * i30
    t22 = t21 * t21
    t25 = i19 - i1
    t27 = i1 - i25
    t28 = max(t25, t27)
    t29 = max(t28, 0.0)
    t31 = t29 * i31
    t32 = t31 * t31
    t33 = t22 + t32
    t36 = i20 - i2
    t38 = i2 - i26
    t39 = max(t36, t38)
    t40 = max(t39, 0.0)
    t42 = t40 * i32
    t43 = t42 * t42
    t44 = t33 + t43
    t47 = i21 - i3
    t49 = i3 - i27
    t50 = max(t47, t49)
    t51 = max(t50, 0.0)
    t53 = t51 * i33
    t54 = t53 * t53
    t55 = t44 + t54
    t58 = i22 - i4
    t60 = i4 - i28
    t61 = max(t58, t60)
    t62 = max(t61, 0.0)
    t64 = t62 * i34
    t65 = t64 * t64
    t66 = t55 + t65
    t69 = i23 - i5
    t71 = i5 - i29
    t72 = max(t69, t71)
    t73 = max(t72, 0.0)
    t75 = t73 * i35
    t76 = t75 * t75
    t77 = t66 + t76
    t78 = -(t77)
    t79 = exp(t78)
    t80 = t11 * t79
    t81 = i8 * t80
    t84 = i9 * t80
    t87 = i10 * t80
    t90 = i11 * t80
    t93 = i12 * t80
    t96 = i13 * t80
    w[36] = t81
    w[37] = t84
    w[38] = t87
    w[39] = t90
    w[40] = t93
    w[41] = t96
    w[42] = t80
    w[49] = t80
    w[56] = t80
    w[63] = t80
    w[70] = t80
    w[77] = t80


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "cb39d394c69fa60d"),
}
ADDRESSES["near"] = ADDRESSES["full"]
