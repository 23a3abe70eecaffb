"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 4), ('v', 1), ('c', 2)), 1, (), (), (), ('v',))
SIZE = 9
SHARED = (9, 9)


def full(w):
    i6 = w[6]
    i2 = w[2]
    i3 = w[3]
    i1 = w[1]
    i5 = w[5]
    i0 = w[0]
    i4 = w[4]
    t3 = 1.0 if 0.0 < i6 else 0.0
    t6 = i2 + i3
    t7 = abs(t6)
    t8 = 1.0 if i6 < t7 else 0.0
    t9 = (1.0 if t6 > 0.0 else 0.0) - (1.0 if t6 < 0.0 else 0.0)
    t10 = t9 if t8 != 0.0 else 0.0
    t11 = 0.0 if t8 != 0.0 else 1.0
    t14 = 2.0 * i1
    t16 = t14 / i5
    t18 = t16 - 1.0
    t20 = max(t18, (-1.0))
    t21 = min(t20, 1.0)
    t22 = i0 * t21
    t23 = t22 if t11 != 0.0 else 0.0
    t24 = t10 + t23
    t25 = t24 if t3 != 0.0 else 0.0
    t26 = 0.0 if t3 != 0.0 else 1.0
    t27 = t22 if t26 != 0.0 else 0.0
    t28 = t25 + t27
    t29 = i4 * t28
    t31 = t29 / 2.0
    t32 = -(t31)
    t35 = 0.5 * t28
    t36 = -(t35)
    w[7] = t32
    w[8] = t36


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "1d8235d4c444d797"),
}
ADDRESSES["near"] = ADDRESSES["full"]
