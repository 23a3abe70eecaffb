"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 10), ('v', 1), ('c', 7)), 1, (), (), (), ('v',))
SIZE = 20
SHARED = (20, 20)


def full(w):
    i0 = w[0]
    i14 = w[14]
    i13 = w[13]
    i11 = w[11]
    i10 = w[10]
    i12 = w[12]
    i9 = w[9]
    t4 = i0 - i14
    t5 = i13 * t4
    t7 = t5 / i11
    t8 = t7 * t7
    t9 = i10 * t8
    t11 = t9 / 4.0
    t13 = t11 / i12
    t15 = i13 * i9
    t16 = t13 / t15
    t17 = -(t16)
    t20 = 0.25 * t8
    t21 = t20 / i12
    t22 = t21 / t15
    t23 = -(t22)
    w[18] = t17
    w[19] = t23


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "921687c654a634d3"),
}
ADDRESSES["near"] = ADDRESSES["full"]
