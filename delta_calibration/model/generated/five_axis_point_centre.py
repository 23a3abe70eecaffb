"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('x', 4), ('q', 0), ('g', 0)), 3, (), (), (), ('x', 'q'))
SIZE = 19
SHARED = (19, 19)


def full(w):
    i0 = w[0]
    i1 = w[1]
    w[4] = 0.0
    w[5] = i0
    w[6] = i1
    w[11] = 1.0
    w[16] = 1.0


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "77993494fcf107b1"),
}
ADDRESSES["near"] = ADDRESSES["full"]
