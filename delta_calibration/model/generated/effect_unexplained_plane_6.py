"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 8), ('v', 1), ('c', 22)), 1, (), (), (), ('v',))
SIZE = 33
SHARED = (33, 33)


def full(w):
    i6 = w[6]
    i9 = w[9]
    i8 = w[8]
    i10 = w[10]
    i7 = w[7]
    i11 = w[11]
    i12 = w[12]
    i13 = w[13]
    i0 = w[0]
    i19 = w[19]
    i25 = w[25]
    i14 = w[14]
    i1 = w[1]
    i20 = w[20]
    i26 = w[26]
    i15 = w[15]
    i2 = w[2]
    i21 = w[21]
    i27 = w[27]
    i16 = w[16]
    i3 = w[3]
    i22 = w[22]
    i28 = w[28]
    i17 = w[17]
    i4 = w[4]
    i23 = w[23]
    i29 = w[29]
    i18 = w[18]
    i5 = w[5]
    i24 = w[24]
    i30 = w[30]
    t3 = i6 - i9
    t4 = i8 * t3
    t6 = t4 * i10
    t9 = i7 - i11
    t11 = t9 * i12
    t12 = t6 * t11
    t15 = i13 - i0
    t17 = i0 - i19
    t18 = max(t15, t17)
    t20 = max(t18, 0.0)
    t22 = t20 * i25
    t23 = t22 * t22
    t26 = i14 - i1
    t28 = i1 - i20
    t29 = max(t26, t28)
    t30 = max(t29, 0.0)
    t32 = t30 * i26
    t33 = t32 * t32
    t34 = t23 + t33
    t37 = i15 - i2
    t39 = i2 - i21
    t40 = max(t37, t39)
    t41 = max(t40, 0.0)
    t43 = t41 * i27
    t44 = t43 * t43
    t45 = t34 + t44
    t48 = i16 - i3
    t50 = i3 - i22
    t51 = max(t48, t50)
    t52 = max(t51, 0.0)
    t54 = t52 * i28
    t55 = t54 * t54
    t56 = t45 + t55
    t59 = i17 - i4
    t61 = i4 - i23
    t62 = max(t59, t61)
    t63 = max(t62, 0.0)
    t65 = t63 * i29
    t66 = t65 * t65
    t67 = t56 + t66
    t70 = i18 - i5
    t72 = i5 - i24
    t73 = max(t70, t72)
    t74 = max(t73, 0.0)
    t76 = t74 * i30
    t77 = t76 * t76
    t78 = t67 + t77
    t79 = -(t78)
    t80 = exp(t79)
    t81 = t12 * t80
    t83 = i10 * t3
    t84 = t11 * t83
    t85 = t80 * t84
    w[31] = t81
    w[32] = t85


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "9bf58f3b9d8e7632"),
}
ADDRESSES["near"] = ADDRESSES["full"]
