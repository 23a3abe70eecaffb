"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp, sin

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 2), ('v', 1), ('c', 5)), 1, (), (), (), ('v',))
SIZE = 10
SHARED = (10, 10)


def full(w):
    i0 = w[0]
    i3 = w[3]
    i2 = w[2]
    i4 = w[4]
    i1 = w[1]
    i6 = w[6]
    i7 = w[7]
    i5 = w[5]
    t3 = i0 - i3
    t4 = i2 * t3
    t7 = 1.0 if 0.0 < i4 else 0.0
    t10 = i1 - 20.0
    t11 = t10 if t7 != 0.0 else 0.0
    t12 = 0.0 if t7 != 0.0 else 1.0
    t14 = 1.0 if 0.0 < i6 else 0.0
    t16 = 6.283185307179586 * i1
    t18 = max(i6, 1e-09)
    t19 = t16 / t18
    t21 = 6.283185307179586 * i7
    t22 = t19 + t21
    t23 = sin(t22)
    t24 = sin(t21)
    t25 = t23 - t24
    t26 = t25 if t14 != 0.0 else 0.0
    t27 = 0.0 if t14 != 0.0 else 1.0
    t29 = 1.0 if 0.0 < i5 else 0.0
    t31 = max(i1, 0.0)
    t32 = max(i5, 1e-09)
    t33 = t31 / t32
    t34 = -(t33)
    t35 = exp(t34)
    t36 = 1.0 - t35
    t37 = t36 if t29 != 0.0 else 0.0
    t38 = 0.0 if t29 != 0.0 else 1.0
    t40 = i1 / 3600.0
    t41 = t40 if t38 != 0.0 else 0.0
    t42 = t37 + t41
    t43 = t42 if t27 != 0.0 else 0.0
    t44 = t26 + t43
    t45 = t44 if t12 != 0.0 else 0.0
    t46 = t11 + t45
    t47 = t4 * t46
    t49 = t46 * t3
    w[8] = t47
    w[9] = t49


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "269010ac9fc617da"),
}
ADDRESSES["near"] = ADDRESSES["full"]
