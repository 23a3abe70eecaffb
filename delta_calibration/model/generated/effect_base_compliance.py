"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 6), ('v', 5), ('c', 0)), 6, (), (), (), ('v',))
SIZE = 47
SHARED = (47, 47)


def full(w):
    i6 = w[6]
    i0 = w[0]
    i10 = w[10]
    i4 = w[4]
    i1 = w[1]
    i3 = w[3]
    i7 = w[7]
    i2 = w[2]
    i8 = w[8]
    i9 = w[9]
    i5 = w[5]
    t2 = i6 * i0
    t5 = i10 * i4
    t6 = t2 + t5
    t9 = i6 * i1
    t11 = i10 * i3
    t12 = t9 - t11
    t16 = i7 * i2
    t19 = i8 * i3
    t20 = i10 * i1
    t21 = t19 - t20
    t23 = i8 * i4
    t24 = i10 * i0
    t25 = t23 + t24
    t29 = i9 * i5
    t57 = -(i3)
    t60 = -(i1)
    w[11] = t6
    w[12] = t12
    w[13] = t16
    w[14] = t21
    w[15] = t25
    w[16] = t29
    w[17] = i0
    w[22] = i1
    w[27] = 0.0
    w[32] = 0.0
    w[37] = 0.0
    w[42] = 0.0
    w[18] = 0.0
    w[23] = 0.0
    w[28] = i2
    w[33] = 0.0
    w[38] = 0.0
    w[43] = 0.0
    w[19] = 0.0
    w[24] = 0.0
    w[29] = 0.0
    w[34] = i3
    w[39] = i4
    w[44] = 0.0
    w[20] = 0.0
    w[25] = 0.0
    w[30] = 0.0
    w[35] = 0.0
    w[40] = 0.0
    w[45] = i5
    w[21] = i4
    w[26] = t57
    w[31] = 0.0
    w[36] = t60
    w[41] = i0
    w[46] = 0.0


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "0c572c93e22594f2"),
}
ADDRESSES["near"] = ADDRESSES["full"]
