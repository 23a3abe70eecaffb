"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import sin, tanh

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 4), ('v', 1), ('c', 6)), 2, (), (), (), ('v',))
SIZE = 15
SHARED = (15, 15)


def full(w):
    i5 = w[5]
    i1 = w[1]
    i0 = w[0]
    i2 = w[2]
    i10 = w[10]
    i9 = w[9]
    i7 = w[7]
    i3 = w[3]
    i8 = w[8]
    i6 = w[6]
    i4 = w[4]
    t3 = 1.0 if 0.0 < i5 else 0.0
    t7 = (-2.0) * i1
    t8 = i0 + t7
    t10 = t8 / 2.0
    t17 = i2 - i10
    t18 = i9 * t17
    t19 = sin(t18)
    t20 = i7 * t19
    t21 = i3 + t20
    t23 = t21 / i8
    t24 = i6 * t23
    t25 = t10 + t24
    t27 = max(i5, 1e-12)
    t28 = t25 / t27
    t29 = -(t28)
    t30 = tanh(t29)
    t31 = t30 if t3 != 0.0 else 0.0
    t32 = 0.0 if t3 != 0.0 else 1.0
    t33 = -(t25)
    t34 = (1.0 if t33 > 0.0 else 0.0) - (1.0 if t33 < 0.0 else 0.0)
    t35 = t34 if t32 != 0.0 else 0.0
    t36 = t31 + t35
    t37 = i4 * t36
    t38 = t7 - i0
    t39 = t38 / 2.0
    t40 = t39 - t24
    t41 = t40 / t27
    t42 = tanh(t41)
    t43 = t42 if t3 != 0.0 else 0.0
    t44 = (1.0 if t40 > 0.0 else 0.0) - (1.0 if t40 < 0.0 else 0.0)
    t45 = t44 if t32 != 0.0 else 0.0
    t46 = t43 + t45
    t47 = i4 * t46
    t48 = t37 + t47
    t49 = t48 / 2.0
    t51 = t47 - t37
    t54 = t36 + t46
    t55 = 0.5 * t54
    t57 = t46 - t36
    w[11] = t49
    w[12] = t51
    w[13] = t55
    w[14] = t57


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "40fada8fefdc8554"),
}
ADDRESSES["near"] = ADDRESSES["full"]
