"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('x', 6), ('q', 0), ('g', 0)), 3, (), (), (), ('x', 'q'))
SIZE = 27
SHARED = (27, 27)


def full(w):
    i0 = w[0]
    i1 = w[1]
    i2 = w[2]
    w[6] = i0
    w[7] = i1
    w[8] = i2
    w[9] = 1.0
    w[16] = 1.0
    w[23] = 1.0


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "2f255512693b86ac"),
}
ADDRESSES["near"] = ADDRESSES["full"]
