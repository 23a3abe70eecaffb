"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import cos, sin

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 16), ('v', 2), ('c', 10)), 1, (), (), (), ('v',))
SIZE = 31
SHARED = (31, 31)


def full(w):
    i0 = w[0]
    i21 = w[21]
    i20 = w[20]
    i18 = w[18]
    i16 = w[16]
    i17 = w[17]
    i19 = w[19]
    i15 = w[15]
    t4 = i0 - i21
    t5 = i20 * t4
    t7 = t5 / i18
    t8 = sin(t7)
    t9 = i16 * t8
    t11 = cos(t7)
    t13 = t11 - 1.0
    t14 = i17 * t13
    t15 = t9 + t14
    t17 = t15 / i19
    t19 = i20 * i15
    t20 = t17 / t19
    t22 = t8 / i19
    t23 = t22 / t19
    t25 = t13 / i19
    t26 = t25 / t19
    w[28] = t20
    w[29] = t23
    w[30] = t26


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "c7f7d37e84198cde"),
}
ADDRESSES["near"] = ADDRESSES["full"]
