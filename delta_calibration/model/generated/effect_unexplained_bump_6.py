"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from math import exp

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 7), ('v', 1), ('c', 26)), 1, (), (), (), ('v',))
SIZE = 36
SHARED = (36, 36)


def full(w):
    i15 = w[15]
    i6 = w[6]
    i7 = w[7]
    i0 = w[0]
    i8 = w[8]
    i1 = w[1]
    i9 = w[9]
    i2 = w[2]
    i10 = w[10]
    i3 = w[3]
    i11 = w[11]
    i4 = w[4]
    i12 = w[12]
    i5 = w[5]
    i13 = w[13]
    i14 = w[14]
    i16 = w[16]
    i22 = w[22]
    i28 = w[28]
    i17 = w[17]
    i23 = w[23]
    i29 = w[29]
    i18 = w[18]
    i24 = w[24]
    i30 = w[30]
    i19 = w[19]
    i25 = w[25]
    i31 = w[31]
    i20 = w[20]
    i26 = w[26]
    i32 = w[32]
    i21 = w[21]
    i27 = w[27]
    i33 = w[33]
    t3 = 1.0 if 0.0 < i15 else 0.0
    t5 = i6 if t3 != 0.0 else 0.0
    t6 = 0.0 if t3 != 0.0 else 1.0
    t8 = 1.0 if t6 != 0.0 else 0.0
    t9 = t5 + t8
    t10 = i7 * t9
    t13 = i0 - i8
    t14 = t13 * t13
    t17 = i1 - i9
    t18 = t17 * t17
    t19 = t14 + t18
    t22 = i2 - i10
    t23 = t22 * t22
    t24 = t19 + t23
    t27 = i3 - i11
    t28 = t27 * t27
    t29 = t24 + t28
    t32 = i4 - i12
    t33 = t32 * t32
    t34 = t29 + t33
    t37 = i5 - i13
    t38 = t37 * t37
    t39 = t34 + t38
    t41 = t39 * i14
    t43 = i16 - i0
    t45 = i0 - i22
    t46 = max(t43, t45)
    t47 = max(t46, 0.0)
    t49 = t47 * i28
    t50 = t49 * t49
    t52 = i17 - i1
    t54 = i1 - i23
    t55 = max(t52, t54)
    t56 = max(t55, 0.0)
    t58 = t56 * i29
    t59 = t58 * t58
    t60 = t50 + t59
    t62 = i18 - i2
    t64 = i2 - i24
    t65 = max(t62, t64)
    t66 = max(t65, 0.0)
    t68 = t66 * i30
    t69 = t68 * t68
    t70 = t60 + t69
    t72 = i19 - i3
    t74 = i3 - i25
    t75 = max(t72, t74)
    t76 = max(t75, 0.0)
    t78 = t76 * i31
    t79 = t78 * t78
    t80 = t70 + t79
    t82 = i20 - i4
    t84 = i4 - i26
    t85 = max(t82, t84)
    t86 = max(t85, 0.0)
    t88 = t86 * i32
    t89 = t88 * t88
    t90 = t80 + t89
    t92 = i21 - i5
    t94 = i5 - i27
    t95 = max(t92, t94)
    t96 = max(t95, 0.0)
    t98 = t96 * i33
    t99 = t98 * t98
    t100 = t90 + t99
    t101 = t41 + t100
    t102 = -(t101)
    t103 = exp(t102)
    t104 = t10 * t103
    t106 = t103 * t9
    w[34] = t104
    w[35] = t106


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "cc322462056e3744"),
}
ADDRESSES["near"] = ADDRESSES["full"]
