"""Linear algebra on one thread: on small matrices several wait for one another.

A fit multiplies matrices of some hundred rows thousands of times. Handed to two threads, a
product that takes 0.2 ms takes 5 ms as soon as something else wants a core.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from threading import Lock

from threadpoolctl import threadpool_limits

_lock, _limit = Lock(), ExitStack()
_inside = 0  # who holds the limit, which is of the whole process


@contextmanager
def one_thread() -> Iterator[None]:
    """The process's linear algebra on one thread, until the last that asked for it is done."""
    global _inside
    with _lock:
        if not _inside:
            _limit.enter_context(threadpool_limits(limits=1, user_api="blas"))
        _inside += 1
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if not _inside:
                _limit.close()
