"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import idle, law

LAYOUT = ((('s', 0), ('v', 1), ('c', 0)), 1, (), (), (), ('v',))
SIZE = 3
SHARED = (3, 3)


def full(w):
    i0 = w[0]
    w[1] = i0
    w[2] = 1.0


ADDRESSES = {
    "setup": idle(),
    "shared": idle(),
    "near": idle(),
    "full": law(full, "99086ffabb98577a"),
}
ADDRESSES["near"] = ADDRESSES["full"]
