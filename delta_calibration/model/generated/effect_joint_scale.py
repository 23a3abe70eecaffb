"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 1), ('v', 1), ('c', 0)), 1, (), (), (), ('v',))
SIZE = 4
SHARED = (4, 4)


def full(w):
    i1 = w[1]
    i0 = w[0]
    t2 = i1 * i0
    w[2] = t2
    w[3] = i0


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "eefc5a3fbaafd981"),
}
ADDRESSES["near"] = ADDRESSES["full"]
