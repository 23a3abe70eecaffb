"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 3), ('v', 2), ('c', 10)), 2, (), (), (), ('v',))
SIZE = 21
SHARED = (21, 21)


def full(w):
    i8 = w[8]
    i2 = w[2]
    i0 = w[0]
    i5 = w[5]
    i1 = w[1]
    i6 = w[6]
    i7 = w[7]
    i9 = w[9]
    i11 = w[11]
    i13 = w[13]
    i10 = w[10]
    i12 = w[12]
    i14 = w[14]
    i3 = w[3]
    i4 = w[4]
    t3 = 1.0 if 0.0 < i8 else 0.0
    t5 = i2 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t12 = i0 - i5
    t13 = t12 * t12
    t16 = i1 - i6
    t17 = t16 * t16
    t18 = t13 + t17
    t20 = t18 * i7
    t22 = i9 - i0
    t24 = i0 - i11
    t25 = max(t22, t24)
    t26 = max(t25, 0.0)
    t28 = t26 * i13
    t29 = t28 * t28
    t31 = i10 - i1
    t33 = i1 - i12
    t34 = max(t31, t33)
    t35 = max(t34, 0.0)
    t37 = t35 * i14
    t38 = t37 * t37
    t39 = t29 + t38
    t40 = t20 + t39
    t41 = -(t40)
    t42 = exp(t41)
    t43 = t9 * t42
    t44 = i3 * t43
    t47 = i4 * t43
    w[15] = t44
    w[16] = t47
    w[17] = t43
    w[20] = t43


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "a5dbb52256a0909f"),
}
ADDRESSES["near"] = ADDRESSES["full"]
