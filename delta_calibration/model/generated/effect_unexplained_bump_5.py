"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 6), ('v', 1), ('c', 7)), 1, (), (), (), ('v',))
SIZE = 16
SHARED = (16, 16)


def full(w):
    i13 = w[13]
    i5 = w[5]
    i6 = w[6]
    i0 = w[0]
    i7 = w[7]
    i1 = w[1]
    i8 = w[8]
    i2 = w[2]
    i9 = w[9]
    i3 = w[3]
    i10 = w[10]
    i4 = w[4]
    i11 = w[11]
    i12 = w[12]
    t3 = 1.0 if 0.0 < i13 else 0.0
    t5 = i5 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t10 = i6 * t9
    t13 = i0 - i7
    t14 = t13 * t13
    t17 = i1 - i8
    t18 = t17 * t17
    t19 = t14 + t18
    t22 = i2 - i9
    t23 = t22 * t22
    t24 = t19 + t23
    t27 = i3 - i10
    t28 = t27 * t27
    t29 = t24 + t28
    t32 = i4 - i11
    t33 = t32 * t32
    t34 = t29 + t33
    t36 = t34 * i12
    t37 = -(t36)
    t38 = exp(t37)
    t39 = t10 * t38
    t41 = t38 * t9
    w[14] = t39
    w[15] = t41


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "14e89761c8978f54"),
}
ADDRESSES["near"] = ADDRESSES["full"]
