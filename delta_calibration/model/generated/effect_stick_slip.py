"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 2), ('v', 1), ('c', 3)), 1, (), (), (), ('v',))
SIZE = 8
SHARED = (8, 8)


def full(w):
    i2 = w[2]
    i0 = w[0]
    i4 = w[4]
    i1 = w[1]
    i3 = w[3]
    i5 = w[5]
    t2 = i2 * i0
    t5 = 1.0 - i4
    t8 = abs(i1)
    t9 = 1.0 if 0.0 < t8 else 0.0
    t11 = i1 / i3
    t12 = t11 * t11
    t13 = -(t12)
    t14 = exp(t13)
    t15 = t14 if t9 != 0.0 else 0.0
    t16 = 0.0 if t9 != 0.0 else 1.0
    t18 = i5 if t16 != 0.0 else 0.0
    t19 = t15 + t18
    t20 = t5 * t19
    t21 = i4 + t20
    t22 = t2 * t21
    t23 = -(t22)
    t25 = t21 * i0
    t26 = -(t25)
    w[6] = t23
    w[7] = t26


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "b3f8bce8723698b8"),
}
ADDRESSES["near"] = ADDRESSES["full"]
