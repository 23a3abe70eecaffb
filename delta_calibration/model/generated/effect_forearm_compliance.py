"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 2), ('v', 1), ('c', 0)), 2, (), (), (), ('v',))
SIZE = 7
SHARED = (7, 7)


def full(w):
    i1 = w[1]
    i0 = w[0]
    i2 = w[2]
    t3 = (-2.0) * i1
    t5 = t3 - i0
    t7 = t5 / 2.0
    t8 = i2 * t7
    t9 = i0 + t3
    t10 = t9 / 2.0
    t11 = i2 * t10
    t12 = t8 - t11
    t13 = t12 / 2.0
    t15 = t8 + t11
    t18 = t7 - t10
    t19 = 0.5 * t18
    t21 = t7 + t10
    w[3] = t13
    w[4] = t15
    w[5] = t19
    w[6] = t21


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "0ee7df1392f45bfc"),
}
ADDRESSES["near"] = ADDRESSES["full"]
