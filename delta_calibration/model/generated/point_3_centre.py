"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('x', 3), ('q', 0), ('g', 0)), 3, (), (), (), ('x', 'q'))
SIZE = 15
SHARED = (15, 15)


def full(w):
    i0 = w[0]
    i1 = w[1]
    i2 = w[2]
    w[3] = i0
    w[4] = i1
    w[5] = i2
    w[6] = 1.0
    w[10] = 1.0
    w[14] = 1.0


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "92676f800d1bb36f"),
}
ADDRESSES["near"] = ADDRESSES["full"]
