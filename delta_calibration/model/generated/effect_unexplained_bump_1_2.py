"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 2), ('v', 2), ('c', 6)), 2, (), (), (), ('v',))
SIZE = 16
SHARED = (16, 16)


def full(w):
    i6 = w[6]
    i1 = w[1]
    i0 = w[0]
    i4 = w[4]
    i5 = w[5]
    i7 = w[7]
    i8 = w[8]
    i9 = w[9]
    i2 = w[2]
    i3 = w[3]
    t3 = 1.0 if 0.0 < i6 else 0.0
    t5 = i1 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t12 = i0 - i4
    t13 = t12 * t12
    t15 = t13 * i5
    t17 = i7 - i0
    t19 = i0 - i8
    t20 = max(t17, t19)
    t21 = max(t20, 0.0)
    t23 = t21 * i9
    t24 = t23 * t23
    t25 = t15 + t24
    t26 = -(t25)
    t27 = exp(t26)
    t28 = t9 * t27
    t29 = i2 * t28
    t32 = i3 * t28
    w[10] = t29
    w[11] = t32
    w[12] = t28
    w[15] = t28


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "2d26ff512035f26f"),
}
ADDRESSES["near"] = ADDRESSES["full"]
