"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 1), ('v', 1), ('c', 2)), 1, (), (), (), ('v',))
SIZE = 6
SHARED = (6, 6)


def full(w):
    i3 = w[3]
    i0 = w[0]
    i2 = w[2]
    i1 = w[1]
    t3 = 1.0 if 0.0 <= i3 else 0.0
    t5 = 1.0 if i3 <= i0 else 0.0
    t7 = 1.0 if t5 != 0.0 else 0.0
    t8 = t7 if t3 != 0.0 else 0.0
    t9 = 0.0 if t3 != 0.0 else 1.0
    t11 = 1.0 if 0.0 < i2 else 0.0
    t12 = max(i0, 0.0)
    t14 = max(i2, 1e-09)
    t15 = t12 / t14
    t16 = -(t15)
    t17 = exp(t16)
    t18 = 1.0 - t17
    t19 = t18 if t11 != 0.0 else 0.0
    t20 = 0.0 if t11 != 0.0 else 1.0
    t22 = i0 / 3600.0
    t23 = t22 if t20 != 0.0 else 0.0
    t24 = t19 + t23
    t25 = t24 if t9 != 0.0 else 0.0
    t26 = t8 + t25
    t27 = i1 * t26
    w[4] = t27
    w[5] = t26


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "0abfc944e5f53081"),
}
ADDRESSES["near"] = ADDRESSES["full"]
