"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 8), ('v', 1), ('c', 9)), 1, (), (), (), ('v',))
SIZE = 20
SHARED = (20, 20)


def full(w):
    i17 = w[17]
    i7 = w[7]
    i8 = w[8]
    i0 = w[0]
    i9 = w[9]
    i1 = w[1]
    i10 = w[10]
    i2 = w[2]
    i11 = w[11]
    i3 = w[3]
    i12 = w[12]
    i4 = w[4]
    i13 = w[13]
    i5 = w[5]
    i14 = w[14]
    i6 = w[6]
    i15 = w[15]
    i16 = w[16]
    t3 = 1.0 if 0.0 < i17 else 0.0
    t5 = i7 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t10 = i8 * t9
    t13 = i0 - i9
    t14 = t13 * t13
    t17 = i1 - i10
    t18 = t17 * t17
    t19 = t14 + t18
    t22 = i2 - i11
    t23 = t22 * t22
    t24 = t19 + t23
    t27 = i3 - i12
    t28 = t27 * t27
    t29 = t24 + t28
    t32 = i4 - i13
    t33 = t32 * t32
    t34 = t29 + t33
    t37 = i5 - i14
    t38 = t37 * t37
    t39 = t34 + t38
    t42 = i6 - i15
    t43 = t42 * t42
    t44 = t39 + t43
    t46 = t44 * i16
    t47 = -(t46)
    t48 = exp(t47)
    t49 = t10 * t48
    t51 = t48 * t9
    w[18] = t49
    w[19] = t51


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "dfcb77e2eb326c9d"),
}
ADDRESSES["near"] = ADDRESSES["full"]
