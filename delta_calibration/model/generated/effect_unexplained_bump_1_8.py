"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 2), ('v', 8), ('c', 6)), 8, (), (), (), ('v',))
SIZE = 88
SHARED = (88, 88)


def full(w):
    i12 = w[12]
    i1 = w[1]
    i0 = w[0]
    i10 = w[10]
    i11 = w[11]
    i13 = w[13]
    i14 = w[14]
    i15 = w[15]
    i2 = w[2]
    i3 = w[3]
    i4 = w[4]
    i5 = w[5]
    i6 = w[6]
    i7 = w[7]
    i8 = w[8]
    i9 = w[9]
    t3 = 1.0 if 0.0 < i12 else 0.0
    t5 = i1 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t12 = i0 - i10
    t13 = t12 * t12
    t15 = t13 * i11
    t17 = i13 - i0
    t19 = i0 - i14
    t20 = max(t17, t19)
    t21 = max(t20, 0.0)
    t23 = t21 * i15
    t24 = t23 * t23
    t25 = t15 + t24
    t26 = -(t25)
    t27 = exp(t26)
    t28 = t9 * t27
    t29 = i2 * t28
    t32 = i3 * t28
    t35 = i4 * t28
    t38 = i5 * t28
    t41 = i6 * t28
    t44 = i7 * t28
    t47 = i8 * t28
    t50 = i9 * t28
    w[16] = t29
    w[17] = t32
    w[18] = t35
    w[19] = t38
    w[20] = t41
    w[21] = t44
    w[22] = t47
    w[23] = t50
    w[24] = t28
    w[32] = 0.0
    w[40] = 0.0
    w[48] = 0.0
    w[56] = 0.0
    w[64] = 0.0
    w[72] = 0.0
    w[80] = 0.0
    w[25] = 0.0
    w[33] = t28
    w[41] = 0.0
    w[49] = 0.0
    w[57] = 0.0
    w[65] = 0.0
    w[73] = 0.0
    w[81] = 0.0
    w[26] = 0.0
    w[34] = 0.0
    w[42] = t28
    w[50] = 0.0
    w[58] = 0.0
    w[66] = 0.0
    w[74] = 0.0
    w[82] = 0.0
    w[27] = 0.0
    w[35] = 0.0
    w[43] = 0.0
    w[51] = t28
    w[59] = 0.0
    w[67] = 0.0
    w[75] = 0.0
    w[83] = 0.0
    w[28] = 0.0
    w[36] = 0.0
    w[44] = 0.0
    w[52] = 0.0
    w[60] = t28
    w[68] = 0.0
    w[76] = 0.0
    w[84] = 0.0
    w[29] = 0.0
    w[37] = 0.0
    w[45] = 0.0
    w[53] = 0.0
    w[61] = 0.0
    w[69] = t28
    w[77] = 0.0
    w[85] = 0.0
    w[30] = 0.0
    w[38] = 0.0
    w[46] = 0.0
    w[54] = 0.0
    w[62] = 0.0
    w[70] = 0.0
    w[78] = t28
    w[86] = 0.0
    w[31] = 0.0
    w[39] = 0.0
    w[47] = 0.0
    w[55] = 0.0
    w[63] = 0.0
    w[71] = 0.0
    w[79] = 0.0
    w[87] = t28


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "abe483fb1a200ed2"),
}
ADDRESSES["near"] = ADDRESSES["full"]
