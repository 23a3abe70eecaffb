"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 1), ('v', 1), ('c', 0)), 1, (), (), (), ('v',))
SIZE = 4
SHARED = (4, 4)


def full(w):
    i1 = w[1]
    i0 = w[0]
    t2 = i1 * i0
    t3 = -(t2)
    t5 = -(i0)
    w[2] = t3
    w[3] = t5


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "ee190b3aae9e9915"),
}
ADDRESSES["near"] = ADDRESSES["full"]
