"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 5), ('v', 3), ('c', 13)), 3, (), (), (), ('v',))
SIZE = 33
SHARED = (33, 33)


def full(w):
    i3 = w[3]
    i8 = w[8]
    i9 = w[9]
    i4 = w[4]
    i10 = w[10]
    i11 = w[11]
    i12 = w[12]
    i0 = w[0]
    i15 = w[15]
    i18 = w[18]
    i13 = w[13]
    i1 = w[1]
    i16 = w[16]
    i19 = w[19]
    i14 = w[14]
    i2 = w[2]
    i17 = w[17]
    i20 = w[20]
    i5 = w[5]
    i6 = w[6]
    i7 = w[7]
    t3 = i3 - i8
    t5 = t3 * i9
    t8 = i4 - i10
    t10 = t8 * i11
    t11 = t5 * t10
    t14 = i12 - i0
    t16 = i0 - i15
    t17 = max(t14, t16)
    t19 = max(t17, 0.0)
    t21 = t19 * i18
    t22 = t21 * t21
    t25 = i13 - i1
    t27 = i1 - i16
    t28 = max(t25, t27)
    t29 = max(t28, 0.0)
    t31 = t29 * i19
    t32 = t31 * t31
    t33 = t22 + t32
    t36 = i14 - i2
    t38 = i2 - i17
    t39 = max(t36, t38)
    t40 = max(t39, 0.0)
    t42 = t40 * i20
    t43 = t42 * t42
    t44 = t33 + t43
    t45 = -(t44)
    t46 = exp(t45)
    t47 = t11 * t46
    t48 = i5 * t47
    t51 = i6 * t47
    t54 = i7 * t47
    w[21] = t48
    w[22] = t51
    w[23] = t54
    w[24] = t47
    w[28] = t47
    w[32] = t47


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "0eb7b7bffb17a10c"),
}
ADDRESSES["near"] = ADDRESSES["full"]
