"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 16), ('v', 1), ('c', 10)), 1, (), (), (), ('v',))
SIZE = 29
SHARED = (29, 29)


def full(w):
    i0 = w[0]
    i20 = w[20]
    i19 = w[19]
    i17 = w[17]
    i16 = w[16]
    i18 = w[18]
    i15 = w[15]
    t4 = i0 - i20
    t5 = i19 * t4
    t7 = t5 / i17
    t8 = t7 * t7
    t9 = i16 * t8
    t11 = t9 / 4.0
    t13 = t11 / i18
    t15 = i19 * i15
    t16 = t13 / t15
    t17 = -(t16)
    t20 = 0.25 * t8
    t21 = t20 / i18
    t22 = t21 / t15
    t23 = -(t22)
    w[27] = t17
    w[28] = t23


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "edb7362a6eaefaea"),
}
ADDRESSES["near"] = ADDRESSES["full"]
