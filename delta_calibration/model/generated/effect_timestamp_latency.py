"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 3), ('v', 1), ('c', 0)), 3, (), (), (), ('v',))
SIZE = 10
SHARED = (10, 10)


def full(w):
    i3 = w[3]
    i0 = w[0]
    i1 = w[1]
    i2 = w[2]
    t2 = i3 * i0
    t3 = -(t2)
    t6 = i3 * i1
    t7 = -(t6)
    t10 = i3 * i2
    t11 = -(t10)
    t13 = -(i0)
    t15 = -(i1)
    t17 = -(i2)
    w[4] = t3
    w[5] = t7
    w[6] = t11
    w[7] = t13
    w[8] = t15
    w[9] = t17


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "616fec2be5ddb931"),
}
ADDRESSES["near"] = ADDRESSES["full"]
