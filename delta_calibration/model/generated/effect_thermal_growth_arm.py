"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 1), ('v', 1), ('c', 3)), 1, (), (), (), ('v',))
SIZE = 7
SHARED = (7, 7)


def full(w):
    i1 = w[1]
    i2 = w[2]
    i3 = w[3]
    i0 = w[0]
    i4 = w[4]
    t2 = i1 * i2
    t5 = 1.0 if 0.0 < i3 else 0.0
    t8 = i0 - 20.0
    t9 = t8 if t5 != 0.0 else 0.0
    t10 = 0.0 if t5 != 0.0 else 1.0
    t12 = 1.0 if 0.0 < i4 else 0.0
    t14 = max(i0, 0.0)
    t16 = max(i4, 1e-09)
    t17 = t14 / t16
    t18 = -(t17)
    t19 = exp(t18)
    t20 = 1.0 - t19
    t21 = t20 if t12 != 0.0 else 0.0
    t22 = 0.0 if t12 != 0.0 else 1.0
    t24 = i0 / 3600.0
    t25 = t24 if t22 != 0.0 else 0.0
    t26 = t21 + t25
    t27 = t26 if t10 != 0.0 else 0.0
    t28 = t9 + t27
    t29 = t2 * t28
    t31 = t28 * i2
    w[5] = t29
    w[6] = t31


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "6b3f8959a0b78695"),
}
ADDRESSES["near"] = ADDRESSES["full"]
