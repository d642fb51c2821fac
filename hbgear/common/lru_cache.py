"""Cache of the most recently used values."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from threading import Lock
from typing import Generic, TypeVar

Value = TypeVar("Value")


class LRUCache(Generic[Value]):
    """Values of the ``most`` most recently used keys; several threads may use the cache at once.

    A pickle or deep copy is empty, because values can be computed again and may not be picklable.
    """

    def __init__(self, most: int) -> None:
        self.most = most
        self._values: OrderedDict[Hashable, Value] = OrderedDict()
        self._lock = Lock()

    def __reduce__(self) -> tuple[type[LRUCache[Value]], tuple[int]]:
        return LRUCache, (self.most,)

    def get(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """Return the value of a key, computed with ``make`` if it is not stored. Threads may compute it in parallel."""
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
                return self._values[key]
        value = make()
        with self._lock:
            self._values[key] = value
            if len(self._values) > self.most:
                self._values.popitem(last=False)
        return value
