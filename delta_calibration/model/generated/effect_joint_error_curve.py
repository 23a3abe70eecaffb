"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 1), ('v', 1), ('c', 4)), 1, (), (), (), ('v',))
SIZE = 8
SHARED = (8, 8)


def full(w):
    i4 = w[4]
    i0 = w[0]
    i5 = w[5]
    i2 = w[2]
    i3 = w[3]
    i1 = w[1]
    t2 = 1.0 if i4 <= i0 else 0.0
    t4 = 1.0 if i0 <= i5 else 0.0
    t7 = max(i0, i4)
    t8 = min(t7, i5)
    t10 = t8 - i2
    t12 = t10 / i3
    t13 = 1.0 if t12 < 2.0 else 0.0
    t14 = 2.0 - t12
    t15 = t14 if t13 != 0.0 else 0.0
    t16 = 0.0 if t13 != 0.0 else 1.0
    t17 = t12 - 2.0
    t18 = t17 if t16 != 0.0 else 0.0
    t19 = t15 + t18
    t20 = 2.0 - t19
    t22 = max(t20, 0.0)
    t23 = t22 * t22
    t24 = t22 * t23
    t26 = t24 / 6.0
    t29 = t20 - 1.0
    t30 = max(t29, 0.0)
    t31 = t30 * t30
    t32 = t30 * t31
    t33 = 0.6666666666666666 * t32
    t34 = t26 - t33
    t35 = i1 * t34
    t36 = t35 if t4 != 0.0 else 0.0
    t37 = t36 if t2 != 0.0 else 0.0
    t39 = t34 if t4 != 0.0 else 0.0
    t40 = t39 if t2 != 0.0 else 0.0
    w[6] = t37
    w[7] = t40


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "e13dc801415c6272"),
}
ADDRESSES["near"] = ADDRESSES["full"]
