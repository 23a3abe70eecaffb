"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import cos, sin

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 2), ('v', 7), ('c', 6)), 2, (), (), (), ('v',))
SIZE = 31
SHARED = (31, 31)


def full(w):
    i11 = w[11]
    i0 = w[0]
    i13 = w[13]
    i9 = w[9]
    i3 = w[3]
    i2 = w[2]
    i12 = w[12]
    i1 = w[1]
    i14 = w[14]
    i10 = w[10]
    i4 = w[4]
    i5 = w[5]
    i6 = w[6]
    i7 = w[7]
    i8 = w[8]
    t3 = i11 * i0
    t5 = t3 + i13
    t6 = sin(t5)
    t8 = sin(i9)
    t9 = t6 * t8
    t10 = i3 * t9
    t12 = cos(t5)
    t13 = t12 * t8
    t14 = i2 * t13
    t15 = t10 - t14
    t19 = i12 * i1
    t21 = t19 + i14
    t22 = cos(t21)
    t23 = t22 * t12
    t24 = sin(t21)
    t26 = cos(i10)
    t27 = t26 * t6
    t28 = t24 * t27
    t29 = t23 - t28
    t30 = t29 * t8
    t31 = i4 * t30
    t32 = t15 - t31
    t34 = t22 * t27
    t35 = t24 * t12
    t36 = t34 + t35
    t37 = t36 * t8
    t38 = i5 * t37
    t39 = t32 + t38
    t41 = sin(i10)
    t42 = t41 * t6
    t43 = t42 * t8
    t44 = i6 * t43
    t45 = t39 - t44
    t48 = t26 * t8
    t49 = cos(i9)
    t50 = t12 * t49
    t51 = t41 * t50
    t52 = t48 + t51
    t53 = t29 * t52
    t54 = t6 * t49
    t55 = t22 * t54
    t56 = t26 * t50
    t57 = t41 * t8
    t58 = t56 - t57
    t59 = t24 * t58
    t60 = t55 + t59
    t61 = t60 * t42
    t62 = t53 + t61
    t63 = i7 * t62
    t65 = t22 * t58
    t66 = t24 * t54
    t67 = t65 - t66
    t68 = t67 * t42
    t69 = t36 * t52
    t70 = t68 - t69
    t71 = i8 * t70
    t72 = t63 + t71
    t73 = -(t72)
    t75 = -(t13)
    t81 = -(t30)
    t86 = -(t43)
    t90 = -(t62)
    t93 = -(t70)
    w[15] = t45
    w[16] = t73
    w[17] = t75
    w[24] = 0.0
    w[18] = t9
    w[25] = 0.0
    w[19] = t81
    w[26] = 0.0
    w[20] = t37
    w[27] = 0.0
    w[21] = t86
    w[28] = 0.0
    w[22] = 0.0
    w[29] = t90
    w[23] = 0.0
    w[30] = t93


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "6afaf6ca70feaec0"),
}
ADDRESSES["near"] = ADDRESSES["full"]
