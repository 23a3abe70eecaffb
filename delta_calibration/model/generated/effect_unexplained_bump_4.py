"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 5), ('v', 1), ('c', 6)), 1, (), (), (), ('v',))
SIZE = 14
SHARED = (14, 14)


def full(w):
    i11 = w[11]
    i4 = w[4]
    i5 = w[5]
    i0 = w[0]
    i6 = w[6]
    i1 = w[1]
    i7 = w[7]
    i2 = w[2]
    i8 = w[8]
    i3 = w[3]
    i9 = w[9]
    i10 = w[10]
    t3 = 1.0 if 0.0 < i11 else 0.0
    t5 = i4 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t10 = i5 * t9
    t13 = i0 - i6
    t14 = t13 * t13
    t17 = i1 - i7
    t18 = t17 * t17
    t19 = t14 + t18
    t22 = i2 - i8
    t23 = t22 * t22
    t24 = t19 + t23
    t27 = i3 - i9
    t28 = t27 * t27
    t29 = t24 + t28
    t31 = t29 * i10
    t32 = -(t31)
    t33 = exp(t32)
    t34 = t10 * t33
    t36 = t33 * t9
    w[12] = t34
    w[13] = t36


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "bd8001b87c7cdb10"),
}
ADDRESSES["near"] = ADDRESSES["full"]
