"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 7), ('v', 1), ('c', 8)), 1, (), (), (), ('v',))
SIZE = 18
SHARED = (18, 18)


def full(w):
    i15 = w[15]
    i6 = w[6]
    i7 = w[7]
    i0 = w[0]
    i8 = w[8]
    i1 = w[1]
    i9 = w[9]
    i2 = w[2]
    i10 = w[10]
    i3 = w[3]
    i11 = w[11]
    i4 = w[4]
    i12 = w[12]
    i5 = w[5]
    i13 = w[13]
    i14 = w[14]
    t3 = 1.0 if 0.0 < i15 else 0.0
    t5 = i6 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t10 = i7 * t9
    t13 = i0 - i8
    t14 = t13 * t13
    t17 = i1 - i9
    t18 = t17 * t17
    t19 = t14 + t18
    t22 = i2 - i10
    t23 = t22 * t22
    t24 = t19 + t23
    t27 = i3 - i11
    t28 = t27 * t27
    t29 = t24 + t28
    t32 = i4 - i12
    t33 = t32 * t32
    t34 = t29 + t33
    t37 = i5 - i13
    t38 = t37 * t37
    t39 = t34 + t38
    t41 = t39 * i14
    t42 = -(t41)
    t43 = exp(t42)
    t44 = t10 * t43
    t46 = t43 * t9
    w[16] = t44
    w[17] = t46


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "1bf8ad913994f9f9"),
}
ADDRESSES["near"] = ADDRESSES["full"]
