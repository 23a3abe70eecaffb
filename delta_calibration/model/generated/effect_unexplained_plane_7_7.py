"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 9), ('v', 7), ('c', 25)), 7, (), (), (), ('v',))
SIZE = 97
SHARED = (97, 97)


def full(w):
    i7 = w[7]
    i16 = w[16]
    i17 = w[17]
    i8 = w[8]
    i18 = w[18]
    i19 = w[19]
    i20 = w[20]
    i0 = w[0]
    i27 = w[27]
    i34 = w[34]
    i21 = w[21]
    i1 = w[1]
    i28 = w[28]
    i35 = w[35]
    i22 = w[22]
    i2 = w[2]
    i29 = w[29]
    i36 = w[36]
    i23 = w[23]
    i3 = w[3]
    i30 = w[30]
    i37 = w[37]
    i24 = w[24]
    i4 = w[4]
    i31 = w[31]
    i38 = w[38]
    i25 = w[25]
    i5 = w[5]
    i32 = w[32]
    i39 = w[39]
    i26 = w[26]
    i6 = w[6]
    i33 = w[33]
    i40 = w[40]
    i9 = w[9]
    i10 = w[10]
    i11 = w[11]
    i12 = w[12]
    i13 = w[13]
    i14 = w[14]
    i15 = w[15]
    t3 = i7 - i16
    t5 = t3 * i17
    t8 = i8 - i18
    t10 = t8 * i19
    t11 = t5 * t10
    t14 = i20 - i0
    t16 = i0 - i27
    t17 = max(t14, t16)
    t19 = max(t17, 0.0)
    t21 = t19 * i34
    t22 = t21 * t21
    t25 = i21 - i1
    t27 = i1 - i28
    t28 = max(t25, t27)
    t29 = max(t28, 0.0)
    t31 = t29 * i35
    t32 = t31 * t31
    t33 = t22 + t32
    t36 = i22 - i2
    t38 = i2 - i29
    t39 = max(t36, t38)
    t40 = max(t39, 0.0)
    t42 = t40 * i36
    t43 = t42 * t42
    t44 = t33 + t43
    t47 = i23 - i3
    t49 = i3 - i30
    t50 = max(t47, t49)
    t51 = max(t50, 0.0)
    t53 = t51 * i37
    t54 = t53 * t53
    t55 = t44 + t54
    t58 = i24 - i4
    t60 = i4 - i31
    t61 = max(t58, t60)
    t62 = max(t61, 0.0)
    t64 = t62 * i38
    t65 = t64 * t64
    t66 = t55 + t65
    t69 = i25 - i5
    t71 = i5 - i32
    t72 = max(t69, t71)
    t73 = max(t72, 0.0)
    t75 = t73 * i39
    t76 = t75 * t75
    t77 = t66 + t76
    t80 = i26 - i6
    t82 = i6 - i33
    t83 = max(t80, t82)
    t84 = max(t83, 0.0)
    t86 = t84 * i40
    t87 = t86 * t86
    t88 = t77 + t87
    t89 = -(t88)
    t90 = exp(t89)
    t91 = t11 * t90
    t92 = i9 * t91
    t95 = i10 * t91
    t98 = i11 * t91
    t101 = i12 * t91
    t104 = i13 * t91
    t107 = i14 * t91
    t110 = i15 * t91
    w[41] = t92
    w[42] = t95
    w[43] = t98
    w[44] = t101
    w[45] = t104
    w[46] = t107
    w[47] = t110
    w[48] = t91
    w[56] = t91
    w[64] = t91
    w[72] = t91
    w[80] = t91
    w[88] = t91
    w[96] = t91


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "1726301b01122a84"),
}
ADDRESSES["near"] = ADDRESSES["full"]
