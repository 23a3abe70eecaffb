"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 2), ('v', 8), ('c', 6)), 8, (), (), (), ('v',))
SIZE = 88
SHARED = (88, 88)


def full(w):
    i12 = w[12]
    i1 = w[1]
    i0 = w[0]
    i10 = w[10]
    i11 = w[11]
    i13 = w[13]
    i14 = w[14]
    i15 = w[15]
    i2 = w[2]
    i3 = w[3]
    i4 = w[4]
    i5 = w[5]
    i6 = w[6]
    i7 = w[7]
    i8 = w[8]
    i9 = w[9]
    t3 = 1.0 if 0.0 < i12 else 0.0
    t5 = i1 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t12 = i0 - i10
    t13 = t12 * t12
    t15 = t13 * i11
    t17 = i13 - i0
    t19 = i0 - i14
    t20 = max(t17, t19)
    t21 = max(t20, 0.0)
    t23 = t21 * i15
    t24 = t23 * t23
    t25 = t15 + t24
    t26 = -(t25)
    t27 = exp(t26)
    t28 = t9 * t27
    t29 = i2 * t28
    t32 = i3 * t28
    t35 = i4 * t28
    t38 = i5 * t28
    t41 = i6 * t28
    t44 = i7 * t28
    t47 = i8 * t28
    t50 = i9 * t28
    w[16] = t29
    w[17] = t32
    w[18] = t35
    w[19] = t38
    w[20] = t41
    w[21] = t44
    w[22] = t47
    w[23] = t50
    w[24] = t28
    w[33] = t28
    w[42] = t28
    w[51] = t28
    w[60] = t28
    w[69] = t28
    w[78] = t28
    w[87] = t28


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "d993d1994c599a1f"),
}
ADDRESSES["near"] = ADDRESSES["full"]
