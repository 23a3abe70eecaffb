"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import law

LAYOUT = ((('s', 1), ('v', 1), ('c', 0)), 1, (), (), (), ('v',))
SIZE = 4
SHARED = (4, 4)


def setup(w):  # type: ignore[no-untyped-def]
    pass


def shared(w):  # type: ignore[no-untyped-def]
    pass


def near(w):  # type: ignore[no-untyped-def]
    i1 = w[1]
    i0 = w[0]
    t2 = i1 * i0
    w[2] = t2


def full(w):  # type: ignore[no-untyped-def]
    i1 = w[1]
    i0 = w[0]
    t2 = i1 * i0
    w[2] = t2
    w[3] = i0


ADDRESSES = {
    "setup": law(setup, "71c2de1a07adf007"),
    "shared": law(shared, "71c2de1a07adf007"),
    "near": law(near, "71c2de1a07adf007"),
    "full": law(full, "71c2de1a07adf007"),
}
