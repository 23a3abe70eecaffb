"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import tanh

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 2), ('v', 1), ('c', 1)), 2, (), (), (), ('v',))
SIZE = 8
SHARED = (8, 8)


def full(w):
    i3 = w[3]
    i1 = w[1]
    i0 = w[0]
    i2 = w[2]
    t3 = 1.0 if 0.0 < i3 else 0.0
    t7 = (-2.0) * i1
    t8 = i0 + t7
    t10 = t8 / 2.0
    t12 = max(i3, 1e-12)
    t13 = t10 / t12
    t14 = -(t13)
    t15 = tanh(t14)
    t16 = t15 if t3 != 0.0 else 0.0
    t17 = 0.0 if t3 != 0.0 else 1.0
    t18 = -(t10)
    t19 = (1.0 if t18 > 0.0 else 0.0) - (1.0 if t18 < 0.0 else 0.0)
    t20 = t19 if t17 != 0.0 else 0.0
    t21 = t16 + t20
    t22 = i2 * t21
    t23 = t7 - i0
    t24 = t23 / 2.0
    t25 = t24 / t12
    t26 = tanh(t25)
    t27 = t26 if t3 != 0.0 else 0.0
    t28 = (1.0 if t24 > 0.0 else 0.0) - (1.0 if t24 < 0.0 else 0.0)
    t29 = t28 if t17 != 0.0 else 0.0
    t30 = t27 + t29
    t31 = i2 * t30
    t32 = t22 + t31
    t33 = t32 / 2.0
    t35 = t31 - t22
    t38 = t21 + t30
    t39 = 0.5 * t38
    t41 = t30 - t21
    w[4] = t33
    w[5] = t35
    w[6] = t39
    w[7] = t41


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "3c993c91629fece3"),
}
ADDRESSES["near"] = ADDRESSES["full"]
