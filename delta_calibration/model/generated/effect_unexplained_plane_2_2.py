"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 4), ('v', 2), ('c', 10)), 2, (), (), (), ('v',))
SIZE = 22
SHARED = (22, 22)


def full(w):
    i2 = w[2]
    i6 = w[6]
    i7 = w[7]
    i3 = w[3]
    i8 = w[8]
    i9 = w[9]
    i10 = w[10]
    i0 = w[0]
    i12 = w[12]
    i14 = w[14]
    i11 = w[11]
    i1 = w[1]
    i13 = w[13]
    i15 = w[15]
    i4 = w[4]
    i5 = w[5]
    t3 = i2 - i6
    t5 = t3 * i7
    t8 = i3 - i8
    t10 = t8 * i9
    t11 = t5 * t10
    t14 = i10 - i0
    t16 = i0 - i12
    t17 = max(t14, t16)
    t19 = max(t17, 0.0)
    t21 = t19 * i14
    t22 = t21 * t21
    t25 = i11 - i1
    t27 = i1 - i13
    t28 = max(t25, t27)
    t29 = max(t28, 0.0)
    t31 = t29 * i15
    t32 = t31 * t31
    t33 = t22 + t32
    t34 = -(t33)
    t35 = exp(t34)
    t36 = t11 * t35
    t37 = i4 * t36
    t40 = i5 * t36
    w[16] = t37
    w[17] = t40
    w[18] = t36
    w[21] = t36


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "c5638b9bf6eb3f45"),
}
ADDRESSES["near"] = ADDRESSES["full"]
