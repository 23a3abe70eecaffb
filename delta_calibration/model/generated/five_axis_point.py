"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import cos, sin

from delta_calibration.model.jit import idle, law

LAYOUT = ((('x', 4), ('o', 3)), 3, (), ('x',), (), ('x', 'o'))
SIZE = 45
SHARED = (31, 45)


def shared(w):
    i3 = w[3]
    i2 = w[2]
    t1 = cos(i3)
    w[31] = t1
    t4 = sin(i3)
    w[32] = t4
    t11 = sin(i2)
    w[33] = t11
    t12 = t11 * t4
    w[34] = t12
    t14 = cos(i2)
    w[35] = t14
    t18 = t11 * t1
    w[36] = t18
    t25 = t14 * t4
    w[37] = t25
    t28 = t14 * t1
    w[38] = t28
    t36 = t4 * t14
    w[39] = t36
    t40 = t1 * t14
    w[40] = t40
    t45 = t4 * t11
    w[41] = t45
    t48 = t1 * t11
    w[42] = t48
    t67 = -(t25)
    w[43] = t67
    t72 = -(t18)
    w[44] = t72


def full(w):
    t1 = w[31]
    i4 = w[4]
    t4 = w[32]
    i6 = w[6]
    t12 = w[34]
    t14 = w[35]
    i5 = w[5]
    t18 = w[36]
    i0 = w[0]
    t11 = w[33]
    t25 = w[37]
    t28 = w[38]
    i1 = w[1]
    t36 = w[39]
    t40 = w[40]
    t45 = w[41]
    t48 = w[42]
    t67 = w[43]
    t72 = w[44]
    t3 = t1 * i4
    t6 = t4 * i6
    t7 = t3 + t6
    t13 = t12 * i4
    t16 = t14 * i5
    t17 = t13 + t16
    t19 = t18 * i6
    t20 = t17 - t19
    t21 = i0 + t20
    t24 = t11 * i5
    t26 = t25 * i4
    t27 = t24 - t26
    t29 = t28 * i6
    t30 = t27 + t29
    t31 = i1 + t30
    t37 = i4 * t36
    t38 = i5 * t11
    t39 = t37 - t38
    t41 = i6 * t40
    t42 = t39 - t41
    t44 = i5 * t14
    t46 = i4 * t45
    t47 = t44 + t46
    t49 = i6 * t48
    t50 = t47 - t49
    t52 = i6 * t1
    t53 = i4 * t4
    t54 = t52 - t53
    t56 = i4 * t18
    t57 = i6 * t12
    t58 = t56 + t57
    t60 = i4 * t28
    t61 = i6 * t25
    t62 = t60 + t61
    t63 = -(t62)
    w[7] = t7
    w[8] = t21
    w[9] = t31
    w[14] = 1.0
    w[19] = 1.0
    w[16] = t42
    w[20] = t50
    w[13] = t54
    w[17] = t58
    w[21] = t63
    w[22] = t1
    w[25] = t12
    w[28] = t67
    w[26] = t14
    w[29] = t11
    w[24] = t4
    w[27] = t72
    w[30] = t28


ADDRESSES = {
    "setup": idle(),
    "shared": law(shared, "89c6ba24a39a11ed"),
    "near": idle(),
    "full": law(full, "89c6ba24a39a11ed"),
}
ADDRESSES["near"] = ADDRESSES["full"]
