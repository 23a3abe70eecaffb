"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import law

LAYOUT = ((('x', 4), ('q', 0), ('g', 0)), 3, (), (), (), ('x', 'q'))
SIZE = 19
SHARED = (19, 19)


def setup(w):  # type: ignore[no-untyped-def]
    pass


def shared(w):  # type: ignore[no-untyped-def]
    pass


def near(w):  # type: ignore[no-untyped-def]
    i0 = w[0]
    i1 = w[1]
    w[4] = 0.0
    w[5] = i0
    w[6] = i1


def full(w):  # type: ignore[no-untyped-def]
    i0 = w[0]
    i1 = w[1]
    w[4] = 0.0
    w[5] = i0
    w[6] = i1
    w[7] = 0.0
    w[11] = 1.0
    w[15] = 0.0
    w[8] = 0.0
    w[12] = 0.0
    w[16] = 1.0
    w[9] = 0.0
    w[13] = 0.0
    w[17] = 0.0
    w[10] = 0.0
    w[14] = 0.0
    w[18] = 0.0


ADDRESSES = {
    "setup": law(setup, "1da0a2534990a299"),
    "shared": law(shared, "1da0a2534990a299"),
    "near": law(near, "1da0a2534990a299"),
    "full": law(full, "1da0a2534990a299"),
}
