"""Restricts linear algebra to one thread: on small matrices several threads wait for one another.

A fit multiplies matrices of some hundred rows thousands of times. Handed to two threads, a
product that takes 0.2 ms takes 5 ms as soon as something else wants a core.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from threading import Lock

import scipy.linalg  # noqa: F401 - loads its BLAS, so that it can be limited as numpy's is
from threadpoolctl import ThreadpoolController

_lock, _limit = Lock(), ExitStack()
_inside = 0  # number of callers that hold the limit, which applies to the whole process


@contextmanager
def one_thread() -> Iterator[None]:
    """Run the process's linear algebra on one thread until the last caller has left."""
    global _inside
    with _lock:
        if not _inside:
            _limit.enter_context(_libraries().limit(limits=1, user_api="blas"))
        _inside += 1
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if not _inside:
                _limit.close()


@cache
def _libraries() -> ThreadpoolController:
    """Controller of the linear algebra libraries, cached: the search takes a millisecond."""
    return ThreadpoolController()
