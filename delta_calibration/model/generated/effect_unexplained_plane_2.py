"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 4), ('v', 1), ('c', 10)), 1, (), (), (), ('v',))
SIZE = 17
SHARED = (17, 17)


def full(w):
    i2 = w[2]
    i5 = w[5]
    i4 = w[4]
    i6 = w[6]
    i3 = w[3]
    i7 = w[7]
    i8 = w[8]
    i9 = w[9]
    i0 = w[0]
    i11 = w[11]
    i13 = w[13]
    i10 = w[10]
    i1 = w[1]
    i12 = w[12]
    i14 = w[14]
    t3 = i2 - i5
    t4 = i4 * t3
    t6 = t4 * i6
    t9 = i3 - i7
    t11 = t9 * i8
    t12 = t6 * t11
    t15 = i9 - i0
    t17 = i0 - i11
    t18 = max(t15, t17)
    t20 = max(t18, 0.0)
    t22 = t20 * i13
    t23 = t22 * t22
    t26 = i10 - i1
    t28 = i1 - i12
    t29 = max(t26, t28)
    t30 = max(t29, 0.0)
    t32 = t30 * i14
    t33 = t32 * t32
    t34 = t23 + t33
    t35 = -(t34)
    t36 = exp(t35)
    t37 = t12 * t36
    t39 = i6 * t3
    t40 = t11 * t39
    t41 = t36 * t40
    w[15] = t37
    w[16] = t41


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "e339393f8c464318"),
}
ADDRESSES["near"] = ADDRESSES["full"]
