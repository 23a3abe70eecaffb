"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import law

LAYOUT = ((('s', 3), ('v', 1), ('c', 0)), 3, (), (), (), ('v',))
SIZE = 10
SHARED = (10, 10)


def setup(w):  # type: ignore[no-untyped-def]
    pass


def shared(w):  # type: ignore[no-untyped-def]
    pass


def near(w):  # type: ignore[no-untyped-def]
    i3 = w[3]
    i0 = w[0]
    i1 = w[1]
    i2 = w[2]
    t2 = i3 * i0
    t5 = i3 * i1
    t8 = i3 * i2
    w[4] = t2
    w[5] = t5
    w[6] = t8


def full(w):  # type: ignore[no-untyped-def]
    i3 = w[3]
    i0 = w[0]
    i1 = w[1]
    i2 = w[2]
    t2 = i3 * i0
    t5 = i3 * i1
    t8 = i3 * i2
    w[4] = t2
    w[5] = t5
    w[6] = t8
    w[7] = i0
    w[8] = i1
    w[9] = i2


ADDRESSES = {
    "setup": law(setup, "c74781c9594f4943"),
    "shared": law(shared, "c74781c9594f4943"),
    "near": law(near, "c74781c9594f4943"),
    "full": law(full, "c74781c9594f4943"),
}
