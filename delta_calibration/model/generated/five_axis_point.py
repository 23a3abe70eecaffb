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
    t42 = t4 * t14
    w[39] = t42
    t46 = t1 * t14
    w[40] = t46
    t51 = t4 * t11
    w[41] = t51
    t54 = t1 * t11
    w[42] = t54
    t73 = -(t25)
    w[43] = t73
    t79 = -(t18)
    w[44] = t79


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
    t42 = w[39]
    t46 = w[40]
    t51 = w[41]
    t54 = w[42]
    t73 = w[43]
    t79 = w[44]
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
    t43 = i4 * t42
    t44 = i5 * t11
    t45 = t43 - t44
    t47 = i6 * t46
    t48 = t45 - t47
    t50 = i5 * t14
    t52 = i4 * t51
    t53 = t50 + t52
    t55 = i6 * t54
    t56 = t53 - t55
    t58 = i6 * t1
    t59 = i4 * t4
    t60 = t58 - t59
    t62 = i4 * t18
    t63 = i6 * t12
    t64 = t62 + t63
    t66 = i4 * t28
    t67 = i6 * t25
    t68 = t66 + t67
    t69 = -(t68)
    w[7] = t7
    w[8] = t21
    w[9] = t31
    w[10] = 0.0
    w[14] = 1.0
    w[18] = 0.0
    w[11] = 0.0
    w[15] = 0.0
    w[19] = 1.0
    w[12] = 0.0
    w[16] = t48
    w[20] = t56
    w[13] = t60
    w[17] = t64
    w[21] = t69
    w[22] = t1
    w[25] = t12
    w[28] = t73
    w[23] = 0.0
    w[26] = t14
    w[29] = t11
    w[24] = t4
    w[27] = t79
    w[30] = t28


ADDRESSES = {
    "setup": idle(),
    "shared": law(shared, "7590fa822761d54f"),
    "near": idle(),
    "full": law(full, "7590fa822761d54f"),
}
ADDRESSES["near"] = ADDRESSES["full"]
