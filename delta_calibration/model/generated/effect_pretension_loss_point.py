"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp, sqrt

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 10), ('v', 1), ('c', 8)), 1, (), (), (), ('v',))
SIZE = 21
SHARED = (21, 21)


def full(w):
    i18 = w[18]
    i2 = w[2]
    i10 = w[10]
    i1 = w[1]
    i3 = w[3]
    i6 = w[6]
    i4 = w[4]
    i7 = w[7]
    i5 = w[5]
    i8 = w[8]
    i13 = w[13]
    i9 = w[9]
    t3 = 1.0 if 0.0 < i18 else 0.0
    t6 = max(i2, 0.0)
    t8 = max(i18, 1e-09)
    t9 = t6 / t8
    t10 = -(t9)
    t11 = exp(t10)
    t12 = 1.0 - t11
    t13 = t12 if t3 != 0.0 else 0.0
    t14 = 0.0 if t3 != 0.0 else 1.0
    t16 = i2 / 3600.0
    t17 = t16 if t14 != 0.0 else 0.0
    t18 = t13 + t17
    t19 = i10 * t18
    t21 = t19 * i1
    t24 = i3 - i6
    t25 = t24 * t24
    t28 = i4 - i7
    t29 = t28 * t28
    t30 = t25 + t29
    t33 = i5 - i8
    t34 = t33 * t33
    t35 = t30 + t34
    t36 = sqrt(t35)
    t37 = t21 * t36
    t40 = i13 * i9
    t41 = t37 / t40
    t42 = -(t41)
    t44 = i1 * t18
    t45 = t36 * t44
    t46 = t45 / t40
    t47 = -(t46)
    w[19] = t42
    w[20] = t47


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "09758d267147db9a"),
}
ADDRESSES["near"] = ADDRESSES["full"]
