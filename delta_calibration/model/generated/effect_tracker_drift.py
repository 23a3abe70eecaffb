"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp, sin

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 4), ('v', 6), ('c', 4)), 3, (), (), (), ('v',))
SIZE = 35
SHARED = (35, 35)


def full(w):
    i8 = w[8]
    i2 = w[2]
    i9 = w[9]
    i1 = w[1]
    i4 = w[4]
    i11 = w[11]
    i3 = w[3]
    i12 = w[12]
    i13 = w[13]
    i10 = w[10]
    i0 = w[0]
    i7 = w[7]
    i5 = w[5]
    i6 = w[6]
    t3 = i8 * i2
    t6 = i9 * i1
    t7 = t3 - t6
    t8 = i4 + t7
    t11 = 1.0 if 0.0 <= i11 else 0.0
    t13 = 1.0 if i11 <= i3 else 0.0
    t15 = 1.0 if t13 != 0.0 else 0.0
    t16 = t15 if t11 != 0.0 else 0.0
    t17 = 0.0 if t11 != 0.0 else 1.0
    t19 = 1.0 if 0.0 < i12 else 0.0
    t21 = 6.283185307179586 * i3
    t23 = max(i12, 1e-09)
    t24 = t21 / t23
    t26 = 6.283185307179586 * i13
    t27 = t24 + t26
    t28 = sin(t27)
    t29 = sin(t26)
    t30 = t28 - t29
    t31 = t30 if t19 != 0.0 else 0.0
    t32 = 0.0 if t19 != 0.0 else 1.0
    t34 = 1.0 if 0.0 < i10 else 0.0
    t35 = max(i3, 0.0)
    t36 = max(i10, 1e-09)
    t37 = t35 / t36
    t38 = -(t37)
    t39 = exp(t38)
    t40 = 1.0 - t39
    t41 = t40 if t34 != 0.0 else 0.0
    t42 = 0.0 if t34 != 0.0 else 1.0
    t44 = i3 / 3600.0
    t45 = t44 if t42 != 0.0 else 0.0
    t46 = t41 + t45
    t47 = t46 if t32 != 0.0 else 0.0
    t48 = t31 + t47
    t49 = t48 if t17 != 0.0 else 0.0
    t50 = t16 + t49
    t51 = t8 * t50
    t55 = i9 * i0
    t57 = i7 * i2
    t58 = t55 - t57
    t59 = i5 + t58
    t60 = t59 * t50
    t63 = i7 * i1
    t64 = i8 * i0
    t65 = t63 - t64
    t66 = i6 + t65
    t67 = t66 * t50
    t72 = t50 * i2
    t73 = -(t72)
    t75 = t50 * i1
    t78 = t50 * i0
    t79 = -(t78)
    t81 = -(t75)
    w[14] = t51
    w[15] = t60
    w[16] = t67
    w[17] = t50
    w[24] = t50
    w[31] = t50
    w[26] = t73
    w[32] = t75
    w[21] = t72
    w[33] = t79
    w[22] = t81
    w[28] = t78


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "e1cf416fc04d5fcd"),
}
ADDRESSES["near"] = ADDRESSES["full"]
