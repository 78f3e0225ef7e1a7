"""Items of an iterable, made in a thread while the consumer works on earlier ones."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from typing import TypeVar

T = TypeVar("T")


@contextmanager
def ahead(items: Iterable[T], count: int = 1) -> Iterator[Iterator[T]]:
    """The items in order. One thread makes them, and at most `count` are made and not yet taken.

    An error of an item is raised in its place. The thread has ended when the context ends.
    """
    source, end = iter(items), object()
    with ThreadPoolExecutor(1, "ahead") as thread:
        taken = _taken(lambda: thread.submit(next, source, end), end, count)
        with closing(taken):
            try:
                yield taken  # type: ignore[misc]
            finally:
                thread.shutdown(cancel_futures=True)


def _taken(begin: Callable[[], Future[object]], end: object, count: int) -> Generator[object, None, None]:
    waiting = deque(begin() for _ in range(count))
    while (item := waiting.popleft().result()) is not end:
        # The next item begins only when this one is taken, so that the queue is bounded.
        waiting.append(begin())
        yield item
