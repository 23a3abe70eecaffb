"""Threads: independent work is divided among the cores; linear algebra uses one thread.

A fit multiplies matrices of some hundred rows thousands of times. Handed to two threads, a
product that takes 0.2 ms takes 5 ms as soon as something else wants a core. Work is therefore
divided into whole fits, scores and tests, each of which stays on its thread.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import cache
from threading import Lock, local
from typing import TypeVar

import scipy.linalg  # noqa: F401 - loads its BLAS, so that it can be limited as numpy's is
from threadpoolctl import ThreadpoolController

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

_THREADS = min(4, os.cpu_count() or 1)
_own = local()  # `busy` in a thread of `mapped`: what it calls is not divided again
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


def mapped(function: Callable[[_Item], _Result], items: Iterable[_Item]) -> list[_Result]:
    """Results of a function for each item, in their order, computed on several threads.

    What such a thread calls is not divided again. With items that take long at the beginning of
    the list no thread waits for another at its end.
    """
    every = list(items)
    if len(every) < 2 or _THREADS < 2 or getattr(_own, "busy", False):
        return [function(item) for item in every]
    with ThreadPoolExecutor(_THREADS, initializer=_begin) as pool:
        return list(pool.map(function, every))


def _begin() -> None:
    _own.busy = True


@cache
def _libraries() -> ThreadpoolController:
    """Controller of the linear algebra libraries, cached: the search takes a millisecond."""
    return ThreadpoolController()
