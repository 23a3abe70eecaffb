"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 6), ('v', 1), ('c', 2)), 6, (), (), (), ('v',))
SIZE = 21
SHARED = (21, 21)


def full(w):
    i6 = w[6]
    i0 = w[0]
    i8 = w[8]
    i7 = w[7]
    i4 = w[4]
    i1 = w[1]
    i3 = w[3]
    i2 = w[2]
    i5 = w[5]
    t2 = i6 * i0
    t5 = i8 * i8
    t6 = i6 / t5
    t7 = 2.0 * t6
    t9 = i7 * i0
    t10 = i4 + t9
    t11 = t7 * t10
    t12 = i7 * t11
    t13 = t2 + t12
    t16 = i6 * i1
    t18 = i7 * i1
    t19 = i3 - t18
    t20 = t7 * t19
    t21 = i7 * t20
    t22 = t16 - t21
    t25 = i6 * i2
    t30 = t6 * i5
    t33 = 2.0 / t5
    t34 = t10 * t33
    t35 = i7 * t34
    t36 = i0 + t35
    t38 = t19 * t33
    t39 = i7 * t38
    t40 = i1 - t39
    t45 = i5 / t5
    w[9] = t13
    w[10] = t22
    w[11] = t25
    w[12] = t20
    w[13] = t11
    w[14] = t30
    w[15] = t36
    w[16] = t40
    w[17] = i2
    w[18] = t38
    w[19] = t34
    w[20] = t45


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "f99b24e3c7fd7e0e"),
}
ADDRESSES["near"] = ADDRESSES["full"]
