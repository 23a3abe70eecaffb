"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 10), ('v', 1), ('c', 5)), 1, (), (), (), ('v',))
SIZE = 18
SHARED = (18, 18)


def full(w):
    i0 = w[0]
    i11 = w[11]
    i10 = w[10]
    i12 = w[12]
    i9 = w[9]
    t3 = i0 / i11
    t4 = t3 * t3
    t5 = i10 * t4
    t7 = t5 / 4.0
    t9 = t7 / i12
    t11 = t9 / i9
    t12 = -(t11)
    t15 = 0.25 * t4
    t16 = t15 / i12
    t17 = t16 / i9
    t18 = -(t17)
    w[16] = t12
    w[17] = t18


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "90390082953569bd"),
}
ADDRESSES["near"] = ADDRESSES["full"]
