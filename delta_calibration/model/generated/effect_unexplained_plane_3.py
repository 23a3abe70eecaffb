"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 5), ('v', 1), ('c', 13)), 1, (), (), (), ('v',))
SIZE = 21
SHARED = (21, 21)


def full(w):
    i3 = w[3]
    i6 = w[6]
    i5 = w[5]
    i7 = w[7]
    i4 = w[4]
    i8 = w[8]
    i9 = w[9]
    i10 = w[10]
    i0 = w[0]
    i13 = w[13]
    i16 = w[16]
    i11 = w[11]
    i1 = w[1]
    i14 = w[14]
    i17 = w[17]
    i12 = w[12]
    i2 = w[2]
    i15 = w[15]
    i18 = w[18]
    t3 = i3 - i6
    t4 = i5 * t3
    t6 = t4 * i7
    t9 = i4 - i8
    t11 = t9 * i9
    t12 = t6 * t11
    t15 = i10 - i0
    t17 = i0 - i13
    t18 = max(t15, t17)
    t20 = max(t18, 0.0)
    t22 = t20 * i16
    t23 = t22 * t22
    t26 = i11 - i1
    t28 = i1 - i14
    t29 = max(t26, t28)
    t30 = max(t29, 0.0)
    t32 = t30 * i17
    t33 = t32 * t32
    t34 = t23 + t33
    t37 = i12 - i2
    t39 = i2 - i15
    t40 = max(t37, t39)
    t41 = max(t40, 0.0)
    t43 = t41 * i18
    t44 = t43 * t43
    t45 = t34 + t44
    t46 = -(t45)
    t47 = exp(t46)
    t48 = t12 * t47
    t50 = i7 * t3
    t51 = t11 * t50
    t52 = t47 * t51
    w[19] = t48
    w[20] = t52


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "9586d16677df8e70"),
}
ADDRESSES["near"] = ADDRESSES["full"]
