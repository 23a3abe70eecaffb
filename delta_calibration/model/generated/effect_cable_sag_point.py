"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import sqrt

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 10), ('v', 1), ('c', 7)), 1, (), (), (), ('v',))
SIZE = 20
SHARED = (20, 20)


def full(w):
    i3 = w[3]
    i6 = w[6]
    i4 = w[4]
    i7 = w[7]
    i5 = w[5]
    i8 = w[8]
    i1 = w[1]
    i15 = w[15]
    i16 = w[16]
    i17 = w[17]
    i2 = w[2]
    i10 = w[10]
    i13 = w[13]
    i9 = w[9]
    t3 = i3 - i6
    t4 = t3 * t3
    t7 = i4 - i7
    t8 = t7 * t7
    t9 = t4 + t8
    t12 = i5 - i8
    t13 = t12 * t12
    t14 = t9 + t13
    t15 = sqrt(t14)
    t16 = t9 * t15
    t19 = i1 * i1
    t20 = 24.0 * t19
    t21 = t16 / t20
    t23 = i15 - i6
    t24 = t23 * t23
    t26 = i16 - i7
    t27 = t26 * t26
    t28 = t24 + t27
    t30 = i17 - i8
    t31 = t30 * t30
    t32 = t28 + t31
    t33 = sqrt(t32)
    t34 = t28 * t33
    t36 = i2 * i2
    t37 = 24.0 * t36
    t38 = t34 / t37
    t39 = t21 - t38
    t40 = i10 * t39
    t43 = i13 * i9
    t44 = t40 / t43
    t45 = -(t44)
    t47 = t39 / t43
    t48 = -(t47)
    w[18] = t45
    w[19] = t48


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "f830e1eabc7f21aa"),
}
ADDRESSES["near"] = ADDRESSES["full"]
