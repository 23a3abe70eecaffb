"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 2), ('v', 1), ('c', 1)), 1, (), (), (), ('v',))
SIZE = 6
SHARED = (6, 6)


def full(w):
    i2 = w[2]
    i0 = w[0]
    i1 = w[1]
    i3 = w[3]
    t2 = i2 * i0
    t4 = 2.0 * i1
    t6 = t4 / i3
    t8 = t6 - 1.0
    t10 = max(t8, (-1.0))
    t11 = min(t10, 1.0)
    t12 = t2 * t11
    t14 = t12 / 2.0
    t15 = -(t14)
    t18 = t11 * i0
    t19 = 0.5 * t18
    t20 = -(t19)
    w[4] = t15
    w[5] = t20


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "d21af1830b070b79"),
}
ADDRESSES["near"] = ADDRESSES["full"]
