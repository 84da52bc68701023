"""A graphics card of NVIDIA's through the library that its driver brings: memory, code, and calls of it.

Nothing else need be installed. Calls from several threads come one after the other.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bwbn_bayes.engines.thread_compiler import OLDEST_CARD, ON_THREADS, thread_code
from bwbn_bayes.errors import UserError

THREADS = 32
"""Threads of a block, one warp: with 32 to 128 a solve took about the same time (H100)."""
_BUFFER, _SIZE, _END = 1, 2, 0
"""What announces a kernel's arguments as one row of bytes: where it begins, and its length."""
_CAPABILITY = 75, 76
"""Attributes of a device: its compute capability, before and after the point."""
_NAMES = ("libcuda.so.1", "libcuda.so", "nvcuda.dll")


class CudaError(RuntimeError):
    """The driver has refused a call."""


class Card:
    """The first card that the driver shows.

    Parameters
    ----------
    library : ctypes.CDLL
        The driver's.

    Raises
    ------
    CudaError
        If there is no card, it is too old, or the driver cannot use it.
    """

    def __init__(self, library: ctypes.CDLL) -> None:
        self._library = library
        self.lock = threading.RLock()
        self._functions: dict[tuple[object, ...], ctypes.c_void_p] = {}
        self._call("cuInit", 0)
        device, context = ctypes.c_int(), ctypes.c_void_p()
        self._call("cuDeviceGet", ctypes.byref(device), 0)
        name = ctypes.create_string_buffer(256)
        self._call("cuDeviceGetName", name, 256, device)
        self.name = name.value.decode()
        self._require_young(device)
        self._call("cuDevicePrimaryCtxRetain", ctypes.byref(context), device)
        self._context = context

    def _require_young(self, device: ctypes.c_int) -> None:
        """Its driver would refuse the code, once a run has begun."""
        major, minor = ctypes.c_int(), ctypes.c_int()
        for number, attribute in zip((major, minor), _CAPABILITY, strict=True):
            self._call("cuDeviceGetAttribute", ctypes.byref(number), attribute, device)
        if (major.value, minor.value) < OLDEST_CARD:
            least = ".".join(map(str, OLDEST_CARD))
            raise CudaError(f"{self.name} has compute capability {major.value}.{minor.value}, {least} is needed")

    def _call(self, name: str, *arguments: Any) -> None:
        outcome = getattr(self._library, name)(*arguments)
        if outcome != 0:
            text = ctypes.c_char_p()
            self._library.cuGetErrorString(outcome, ctypes.byref(text))
            raise CudaError(f"{name}: {(text.value or b'unknown error').decode()}")

    def _here(self, name: str, *arguments: Any) -> None:
        """A call from whichever thread asks."""
        with self.lock:
            self._call("cuCtxSetCurrent", self._context)
            self._call(name, *arguments)

    @property
    def free_bytes(self) -> int:
        """Memory that nobody uses."""
        free, total = ctypes.c_size_t(), ctypes.c_size_t()
        self._here("cuMemGetInfo_v2", ctypes.byref(free), ctypes.byref(total))
        return free.value

    def room(self, n_bytes: int) -> Room:
        """Memory of the card's, whatever it holds."""
        address = ctypes.c_uint64()
        self._here("cuMemAlloc_v2", ctypes.byref(address), ctypes.c_size_t(max(n_bytes, 1)))
        return Room(address.value, lambda: self._here("cuMemFree_v2", address))

    def array(self, values: NDArray[Any]) -> Room:
        """An array's copy on the card."""
        kept = np.ascontiguousarray(values)
        room = self.room(kept.nbytes)
        if kept.nbytes > 0:
            self._here("cuMemcpyHtoD_v2", ctypes.c_uint64(room.address), _start(kept), ctypes.c_size_t(kept.nbytes))
        return room

    def read(self, room: Room, values: NDArray[Any]) -> None:
        """Fill an array that lies row after row from the card; waits for what the card still does."""
        self._here("cuMemcpyDtoH_v2", _start(values), ctypes.c_uint64(room.address), ctypes.c_size_t(values.nbytes))

    def function(
        self, source: str, entry: str, fixed: Mapping[str, int | NDArray[Any]], seldom: Sequence[str]
    ) -> ctypes.c_void_p:
        """A function of a kernel's text; see :func:`~bwbn_bayes.engines.thread_compiler.thread_code`.

        Compiled once, whichever records ask for it: a search looks at ever longer windows of one.
        """
        known = [(name, np.shape(value), np.asarray(value).tobytes()) for name, value in fixed.items()]
        with self.lock:
            key = (source, entry, *seldom, *known)
            if key not in self._functions:
                self._functions[key] = self._loaded(thread_code(source, entry, fixed, seldom))
            return self._functions[key]

    def _loaded(self, ptx: str) -> ctypes.c_void_p:
        module, function = ctypes.c_void_p(), ctypes.c_void_p()
        # The driver makes machine code of it, and keeps that for the next process.
        self._here("cuModuleLoadData", ctypes.byref(module), ctypes.c_char_p(ptx.encode()))
        self._here("cuModuleGetFunction", ctypes.byref(function), module, ctypes.c_char_p(ON_THREADS.encode()))
        return function

    def call(self, function: ctypes.c_void_p, n_threads: int, words: bytes) -> None:
        """Call a function on as many threads or a few more, its arguments words of eight bytes; does not wait."""
        row, size = ctypes.create_string_buffer(words, len(words)), ctypes.c_size_t(len(words))
        extra = (ctypes.c_void_p * 5)(
            *(_BUFFER, ctypes.cast(row, ctypes.c_void_p)), *(_SIZE, ctypes.addressof(size)), _END
        )
        grid, block = (-(-n_threads // THREADS), 1, 1), (THREADS, 1, 1)
        self._here("cuLaunchKernel", function, *grid, *block, 0, None, None, extra)


class Room:
    """Some of a card's memory, given back when nobody holds this any more."""

    def __init__(self, address: int, free: Callable[[], None]) -> None:
        self.address, self._free = address, free

    def __del__(self) -> None:
        with suppress(CudaError):  # at the interpreter's end the card may be gone before this
            self._free()


def _start(values: NDArray[Any]) -> ctypes.c_void_p:
    assert values.flags.c_contiguous
    return ctypes.c_void_p(values.ctypes.data)


@cache
def first_card() -> Card:
    """The first card of this machine.

    Raises
    ------
    UserError
        If there is no driver or no card.
    """
    library = _library(_NAMES)
    if library is None:
        raise UserError("the engine cuda needs a graphics card of NVIDIA's with its driver, and finds no driver here")
    try:
        return Card(library)
    except CudaError as error:
        raise UserError(f"the engine cuda finds a driver of NVIDIA's but no card that it can use ({error})") from error


def _library(names: Sequence[str]) -> ctypes.CDLL | None:
    for name in names:
        with suppress(OSError):
            return ctypes.CDLL(name)
    return None
