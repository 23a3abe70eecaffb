"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import cos, sin

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 10), ('v', 2), ('c', 7)), 1, (), (), (), ('v',))
SIZE = 22
SHARED = (22, 22)


def full(w):
    i0 = w[0]
    i15 = w[15]
    i14 = w[14]
    i12 = w[12]
    i10 = w[10]
    i11 = w[11]
    i13 = w[13]
    i9 = w[9]
    t4 = i0 - i15
    t5 = i14 * t4
    t7 = t5 / i12
    t8 = sin(t7)
    t9 = i10 * t8
    t11 = cos(t7)
    t13 = t11 - 1.0
    t14 = i11 * t13
    t15 = t9 + t14
    t17 = t15 / i13
    t19 = i14 * i9
    t20 = t17 / t19
    t22 = t8 / i13
    t23 = t22 / t19
    t25 = t13 / i13
    t26 = t25 / t19
    w[19] = t20
    w[20] = t23
    w[21] = t26


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "5c04cdf745964adc"),
}
ADDRESSES["near"] = ADDRESSES["full"]
