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
    t3 = -(t2)
    w[2] = t3


def full(w):  # type: ignore[no-untyped-def]
    i1 = w[1]
    i0 = w[0]
    t2 = i1 * i0
    t3 = -(t2)
    t5 = -(i0)
    w[2] = t3
    w[3] = t5


ADDRESSES = {
    "setup": law(setup, "2d64168c5ef865d9"),
    "shared": law(shared, "2d64168c5ef865d9"),
    "near": law(near, "2d64168c5ef865d9"),
    "full": law(full, "2d64168c5ef865d9"),
}
