"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 2), ('v', 3), ('c', 6)), 3, (), (), (), ('v',))
SIZE = 23
SHARED = (23, 23)


def full(w):
    i7 = w[7]
    i1 = w[1]
    i0 = w[0]
    i5 = w[5]
    i6 = w[6]
    i8 = w[8]
    i9 = w[9]
    i10 = w[10]
    i2 = w[2]
    i3 = w[3]
    i4 = w[4]
    t3 = 1.0 if 0.0 < i7 else 0.0
    t5 = i1 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t12 = i0 - i5
    t13 = t12 * t12
    t15 = t13 * i6
    t17 = i8 - i0
    t19 = i0 - i9
    t20 = max(t17, t19)
    t21 = max(t20, 0.0)
    t23 = t21 * i10
    t24 = t23 * t23
    t25 = t15 + t24
    t26 = -(t25)
    t27 = exp(t26)
    t28 = t9 * t27
    t29 = i2 * t28
    t32 = i3 * t28
    t35 = i4 * t28
    w[11] = t29
    w[12] = t32
    w[13] = t35
    w[14] = t28
    w[18] = t28
    w[22] = t28


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "558b68cea8c00bc2"),
}
ADDRESSES["near"] = ADDRESSES["full"]
