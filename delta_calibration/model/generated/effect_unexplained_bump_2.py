"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 3), ('v', 1), ('c', 10)), 1, (), (), (), ('v',))
SIZE = 16
SHARED = (16, 16)


def full(w):
    i7 = w[7]
    i2 = w[2]
    i3 = w[3]
    i0 = w[0]
    i4 = w[4]
    i1 = w[1]
    i5 = w[5]
    i6 = w[6]
    i8 = w[8]
    i10 = w[10]
    i12 = w[12]
    i9 = w[9]
    i11 = w[11]
    i13 = w[13]
    t3 = 1.0 if 0.0 < i7 else 0.0
    t5 = i2 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t10 = i3 * t9
    t13 = i0 - i4
    t14 = t13 * t13
    t17 = i1 - i5
    t18 = t17 * t17
    t19 = t14 + t18
    t21 = t19 * i6
    t23 = i8 - i0
    t25 = i0 - i10
    t26 = max(t23, t25)
    t27 = max(t26, 0.0)
    t29 = t27 * i12
    t30 = t29 * t29
    t32 = i9 - i1
    t34 = i1 - i11
    t35 = max(t32, t34)
    t36 = max(t35, 0.0)
    t38 = t36 * i13
    t39 = t38 * t38
    t40 = t30 + t39
    t41 = t21 + t40
    t42 = -(t41)
    t43 = exp(t42)
    t44 = t10 * t43
    t46 = t43 * t9
    w[14] = t44
    w[15] = t46


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "1c3a9d6781a8c832"),
}
ADDRESSES["near"] = ADDRESSES["full"]
