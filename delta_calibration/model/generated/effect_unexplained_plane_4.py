"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 6), ('v', 1), ('c', 16)), 1, (), (), (), ('v',))
SIZE = 25
SHARED = (25, 25)


def full(w):
    i4 = w[4]
    i7 = w[7]
    i6 = w[6]
    i8 = w[8]
    i5 = w[5]
    i9 = w[9]
    i10 = w[10]
    i11 = w[11]
    i0 = w[0]
    i15 = w[15]
    i19 = w[19]
    i12 = w[12]
    i1 = w[1]
    i16 = w[16]
    i20 = w[20]
    i13 = w[13]
    i2 = w[2]
    i17 = w[17]
    i21 = w[21]
    i14 = w[14]
    i3 = w[3]
    i18 = w[18]
    i22 = w[22]
    t3 = i4 - i7
    t4 = i6 * t3
    t6 = t4 * i8
    t9 = i5 - i9
    t11 = t9 * i10
    t12 = t6 * t11
    t15 = i11 - i0
    t17 = i0 - i15
    t18 = max(t15, t17)
    t20 = max(t18, 0.0)
    t22 = t20 * i19
    t23 = t22 * t22
    t26 = i12 - i1
    t28 = i1 - i16
    t29 = max(t26, t28)
    t30 = max(t29, 0.0)
    t32 = t30 * i20
    t33 = t32 * t32
    t34 = t23 + t33
    t37 = i13 - i2
    t39 = i2 - i17
    t40 = max(t37, t39)
    t41 = max(t40, 0.0)
    t43 = t41 * i21
    t44 = t43 * t43
    t45 = t34 + t44
    t48 = i14 - i3
    t50 = i3 - i18
    t51 = max(t48, t50)
    t52 = max(t51, 0.0)
    t54 = t52 * i22
    t55 = t54 * t54
    t56 = t45 + t55
    t57 = -(t56)
    t58 = exp(t57)
    t59 = t12 * t58
    t61 = i8 * t3
    t62 = t11 * t61
    t63 = t58 * t62
    w[23] = t59
    w[24] = t63


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "16c818a68b996f44"),
}
ADDRESSES["near"] = ADDRESSES["full"]
