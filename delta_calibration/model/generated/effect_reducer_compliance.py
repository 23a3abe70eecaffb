"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""

from delta_calibration.model.jit import law

LAYOUT = ((('s', 2), ('v', 1), ('c', 0)), 1, (), (), (), ('v',))
SIZE = 5
SHARED = (5, 5)


def setup(w):  # type: ignore[no-untyped-def]
    pass


def shared(w):  # type: ignore[no-untyped-def]
    pass


def near(w):  # type: ignore[no-untyped-def]
    i0 = w[0]
    i1 = w[1]
    i2 = w[2]
    t3 = i0 + i1
    t4 = i2 * t3
    t5 = -(t4)
    w[3] = t5


def full(w):  # type: ignore[no-untyped-def]
    i0 = w[0]
    i1 = w[1]
    i2 = w[2]
    t3 = i0 + i1
    t4 = i2 * t3
    t5 = -(t4)
    t7 = -(t3)
    w[3] = t5
    w[4] = t7


ADDRESSES = {
    "setup": law(setup, "5cae32813f9dc41d"),
    "shared": law(shared, "5cae32813f9dc41d"),
    "near": law(near, "5cae32813f9dc41d"),
    "full": law(full, "5cae32813f9dc41d"),
}
