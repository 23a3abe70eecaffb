"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import law

LAYOUT = ((('x', 3), ('q', 0), ('g', 0)), 3, (), (), (), ('x', 'q'))
SIZE = 15
SHARED = (15, 15)


def setup(w):  # type: ignore[no-untyped-def]
    pass


def shared(w):  # type: ignore[no-untyped-def]
    pass


def near(w):  # type: ignore[no-untyped-def]
    i0 = w[0]
    i1 = w[1]
    i2 = w[2]
    w[3] = i0
    w[4] = i1
    w[5] = i2


def full(w):  # type: ignore[no-untyped-def]
    i0 = w[0]
    i1 = w[1]
    i2 = w[2]
    w[3] = i0
    w[4] = i1
    w[5] = i2
    w[6] = 1.0
    w[9] = 0.0
    w[12] = 0.0
    w[7] = 0.0
    w[10] = 1.0
    w[13] = 0.0
    w[8] = 0.0
    w[11] = 0.0
    w[14] = 1.0


ADDRESSES = {
    "setup": law(setup, "c84b5fca8f3e0ee6"),
    "shared": law(shared, "c84b5fca8f3e0ee6"),
    "near": law(near, "c84b5fca8f3e0ee6"),
    "full": law(full, "c84b5fca8f3e0ee6"),
}
