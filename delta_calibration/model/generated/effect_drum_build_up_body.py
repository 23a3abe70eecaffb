"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 16), ('v', 1), ('c', 8)), 1, (), (), (), ('v',))
SIZE = 27
SHARED = (27, 27)


def full(w):
    i0 = w[0]
    i17 = w[17]
    i16 = w[16]
    i18 = w[18]
    i15 = w[15]
    t3 = i0 / i17
    t4 = t3 * t3
    t5 = i16 * t4
    t7 = t5 / 4.0
    t9 = t7 / i18
    t11 = t9 / i15
    t12 = -(t11)
    t15 = 0.25 * t4
    t16 = t15 / i18
    t17 = t16 / i15
    t18 = -(t17)
    w[25] = t12
    w[26] = t18


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "5b81adef7dbc1a53"),
}
ADDRESSES["near"] = ADDRESSES["full"]
