"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp, sin

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 1), ('v', 1), ('c', 5)), 1, (), (), (), ('v',))
SIZE = 9
SHARED = (9, 9)


def full(w):
    i1 = w[1]
    i2 = w[2]
    i3 = w[3]
    i0 = w[0]
    i5 = w[5]
    i6 = w[6]
    i4 = w[4]
    t2 = i1 * i2
    t5 = 1.0 if 0.0 < i3 else 0.0
    t8 = i0 - 20.0
    t9 = t8 if t5 != 0.0 else 0.0
    t10 = 0.0 if t5 != 0.0 else 1.0
    t12 = 1.0 if 0.0 < i5 else 0.0
    t14 = 6.283185307179586 * i0
    t16 = max(i5, 1e-09)
    t17 = t14 / t16
    t19 = 6.283185307179586 * i6
    t20 = t17 + t19
    t21 = sin(t20)
    t22 = sin(t19)
    t23 = t21 - t22
    t24 = t23 if t12 != 0.0 else 0.0
    t25 = 0.0 if t12 != 0.0 else 1.0
    t27 = 1.0 if 0.0 < i4 else 0.0
    t29 = max(i0, 0.0)
    t30 = max(i4, 1e-09)
    t31 = t29 / t30
    t32 = -(t31)
    t33 = exp(t32)
    t34 = 1.0 - t33
    t35 = t34 if t27 != 0.0 else 0.0
    t36 = 0.0 if t27 != 0.0 else 1.0
    t38 = i0 / 3600.0
    t39 = t38 if t36 != 0.0 else 0.0
    t40 = t35 + t39
    t41 = t40 if t25 != 0.0 else 0.0
    t42 = t24 + t41
    t43 = t42 if t10 != 0.0 else 0.0
    t44 = t9 + t43
    t45 = t2 * t44
    t47 = t44 * i2
    w[7] = t45
    w[8] = t47


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "3babb9a92986b56f"),
}
ADDRESSES["near"] = ADDRESSES["full"]
