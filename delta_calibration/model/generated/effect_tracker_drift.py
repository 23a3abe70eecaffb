"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 4), ('v', 6), ('c', 2)), 3, (), (), (), ('v',))
SIZE = 33
SHARED = (33, 33)


def full(w):
    i8 = w[8]
    i2 = w[2]
    i9 = w[9]
    i1 = w[1]
    i4 = w[4]
    i11 = w[11]
    i3 = w[3]
    i10 = w[10]
    i0 = w[0]
    i7 = w[7]
    i5 = w[5]
    i6 = w[6]
    t3 = i8 * i2
    t6 = i9 * i1
    t7 = t3 - t6
    t8 = i4 + t7
    t11 = 1.0 if 0.0 <= i11 else 0.0
    t13 = 1.0 if i11 <= i3 else 0.0
    t15 = 1.0 if t13 != 0.0 else 0.0
    t16 = t15 if t11 != 0.0 else 0.0
    t17 = 0.0 if t11 != 0.0 else 1.0
    t19 = 1.0 if 0.0 < i10 else 0.0
    t20 = max(i3, 0.0)
    t22 = max(i10, 1e-09)
    t23 = t20 / t22
    t24 = -(t23)
    t25 = exp(t24)
    t26 = 1.0 - t25
    t27 = t26 if t19 != 0.0 else 0.0
    t28 = 0.0 if t19 != 0.0 else 1.0
    t30 = i3 / 3600.0
    t31 = t30 if t28 != 0.0 else 0.0
    t32 = t27 + t31
    t33 = t32 if t17 != 0.0 else 0.0
    t34 = t16 + t33
    t35 = t8 * t34
    t39 = i9 * i0
    t41 = i7 * i2
    t42 = t39 - t41
    t43 = i5 + t42
    t44 = t43 * t34
    t47 = i7 * i1
    t48 = i8 * i0
    t49 = t47 - t48
    t50 = i6 + t49
    t51 = t50 * t34
    t56 = t34 * i2
    t57 = -(t56)
    t59 = t34 * i1
    t62 = t34 * i0
    t63 = -(t62)
    t65 = -(t59)
    w[12] = t35
    w[13] = t44
    w[14] = t51
    w[15] = t34
    w[22] = t34
    w[29] = t34
    w[24] = t57
    w[30] = t59
    w[19] = t56
    w[31] = t63
    w[20] = t65
    w[26] = t62


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "1f289fd09193be48"),
}
ADDRESSES["near"] = ADDRESSES["full"]
