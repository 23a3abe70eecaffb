"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp, sin

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 1), ('v', 3), ('c', 4)), 3, (), (), (), ('v',))
SIZE = 20
SHARED = (20, 20)


def full(w):
    i5 = w[5]
    i0 = w[0]
    i6 = w[6]
    i7 = w[7]
    i4 = w[4]
    i1 = w[1]
    i2 = w[2]
    i3 = w[3]
    t3 = 1.0 if 0.0 <= i5 else 0.0
    t5 = 1.0 if i5 <= i0 else 0.0
    t7 = 1.0 if t5 != 0.0 else 0.0
    t8 = t7 if t3 != 0.0 else 0.0
    t9 = 0.0 if t3 != 0.0 else 1.0
    t11 = 1.0 if 0.0 < i6 else 0.0
    t13 = 6.283185307179586 * i0
    t15 = max(i6, 1e-09)
    t16 = t13 / t15
    t18 = 6.283185307179586 * i7
    t19 = t16 + t18
    t20 = sin(t19)
    t21 = sin(t18)
    t22 = t20 - t21
    t23 = t22 if t11 != 0.0 else 0.0
    t24 = 0.0 if t11 != 0.0 else 1.0
    t26 = 1.0 if 0.0 < i4 else 0.0
    t27 = max(i0, 0.0)
    t28 = max(i4, 1e-09)
    t29 = t27 / t28
    t30 = -(t29)
    t31 = exp(t30)
    t32 = 1.0 - t31
    t33 = t32 if t26 != 0.0 else 0.0
    t34 = 0.0 if t26 != 0.0 else 1.0
    t36 = i0 / 3600.0
    t37 = t36 if t34 != 0.0 else 0.0
    t38 = t33 + t37
    t39 = t38 if t24 != 0.0 else 0.0
    t40 = t23 + t39
    t41 = t40 if t9 != 0.0 else 0.0
    t42 = t8 + t41
    t43 = i1 * t42
    t46 = i2 * t42
    t49 = i3 * t42
    w[8] = t43
    w[9] = t46
    w[10] = t49
    w[11] = t42
    w[15] = t42
    w[19] = t42


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "4cdf060a9bc0e499"),
}
ADDRESSES["near"] = ADDRESSES["full"]
