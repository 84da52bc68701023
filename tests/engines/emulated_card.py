"""A graphics card in this machine's own memory, whose threads run the same text one after the other."""

from __future__ import annotations

import ctypes
import struct
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.engines.cuda import Cuda
from bwbn_bayes.engines.cuda_driver import THREADS
from bwbn_bayes.engines.kernel import Compiled, Kernel


class EmulatedRoom:
    def __init__(self, n_bytes: int) -> None:
        self.bytes = np.full(max(n_bytes, 8), 0xEE, dtype=np.uint8)  # whoever reads what nobody wrote sees -2e244
        self.address = self.bytes.ctypes.data


class EmulatedCard:
    """What the engine asks of :class:`~bwbn_bayes.engines.cuda_driver.Card`."""

    def __init__(self, free_bytes: int = 2**30) -> None:
        self.free_bytes = free_bytes
        self.lock = threading.RLock()
        self.calls: list[int] = []

    def room(self, n_bytes: int) -> EmulatedRoom:
        return EmulatedRoom(n_bytes)

    def array(self, values: NDArray[Any]) -> EmulatedRoom:
        room = EmulatedRoom(values.nbytes)
        room.bytes[: values.nbytes] = np.frombuffer(np.ascontiguousarray(values).tobytes(), dtype=np.uint8)
        return room

    def read(self, room: EmulatedRoom, values: NDArray[Any]) -> None:
        values.reshape(-1).view(np.uint8)[:] = room.bytes[: values.nbytes]

    def function(self, source: str, entry: str, fixed: Mapping[str, object], seldom: Sequence[str]) -> Compiled:
        compiled: Compiled = getattr(Kernel("draws", source).functions(entry), entry)
        return compiled

    def call(self, function: Compiled, n_threads: int, words: bytes) -> None:
        self.calls.append(n_threads)
        call = ctypes.CFUNCTYPE(None, ctypes.c_char_p)(function.in_a_row)
        for thread in range(-(-n_threads // THREADS) * THREADS):
            call(struct.pack("q", thread) + words)


@cache
def emulated_card() -> EmulatedCard:
    return EmulatedCard()


@dataclass(frozen=True, kw_only=True)
class EmulatedCuda(Cuda):
    """The engine on an emulated card."""

    @property
    def card(self) -> Any:
        return emulated_card()
