"""The numbers in a MATLAB file of version 5 to 7, read here: SciPy's reader ends the process on a damaged file.

References
----------
.. [1] The MathWorks, "MAT-File Format", chapter 1, "MAT-File Level 5".
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

HEADER = 128
"""Length of the text, version and byte order before the first element. [bytes]"""

MOST_INFLATED = 2**32
"""What a compressed variable may grow to; MATLAB's own limit of one before version 7.3 is 2 GiB. [bytes]"""

DEEPEST = 4
"""Structures within structures that are followed."""

_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_STRUCTURE, _FIRST_NUMERIC, _LAST_NUMERIC = 2, 6, 15
_IS_COMPLEX = 0x0800


class _Element(NamedTuple):
    """A data element: its type, its contents, and where the next one starts."""

    kind: int
    data: memoryview
    end: int


def is_matlab5(data: bytes) -> bool:
    """Whether a file's header is that of a level 5 file, in either byte order."""
    return len(data) >= HEADER and data[124:128] in (b"\x00\x01IM", b"\x01\x00MI")


def arrays(data: bytes) -> Iterator[tuple[str, NDArray[Any]]]:
    """Real numeric arrays of one or two dimensions by name; fields of structures have dotted names.

    Raises
    ------
    ValueError, struct.error, zlib.error
        If the file is damaged.
    """
    order = "<" if data[126:128] == b"IM" else ">"
    for element in _elements(memoryview(data)[HEADER:], order):
        if element.kind == _COMPRESSED:
            inflater = zlib.decompressobj()
            inflated = inflater.decompress(element.data, MOST_INFLATED)
            if not inflater.eof:
                raise ValueError("a compressed variable does not end")
            inner = _element(memoryview(inflated), 0, order)
        else:
            inner = element
        if inner.kind == _MATRIX:
            yield from _matrix(inner.data, order, "", 0)


def _elements(data: memoryview, order: str) -> Iterator[_Element]:
    start = 0
    while start < len(data):
        element = _element(data, start, order)
        yield element
        start = element.end


def _element(data: memoryview, start: int, order: str) -> _Element:
    kind, size = struct.unpack_from(f"{order}II", data, start)
    if kind >> 16:
        # Up to four bytes stand in the tag itself, the size in the upper half of its first word.
        kind, size, first, end = kind & 0xFFFF, kind >> 16, start + 4, start + 8
        if size > 4:
            raise ValueError("a small element is too long")
    else:
        first = start + 8
        # Elements are padded to eight bytes, compressed ones are not.
        end = first + (size if kind == _COMPRESSED else -(-size // 8) * 8)
    if first + size > len(data):
        raise ValueError("an element reaches beyond the file")
    return _Element(kind, data[first : first + size], end)


def _matrix(data: memoryview, order: str, prefix: str, depth: int) -> Iterator[tuple[str, NDArray[Any]]]:
    """The array of one element or those of its fields; ``prefix`` is the name where the element has none."""
    parts = _elements(data, order)
    head = [next(parts, None) for _ in range(3)]
    flags, shape, name = (None if part is None else part.data for part in head)
    if flags is None or shape is None or name is None or len(flags) < 4:
        return
    label = prefix or bytes(name).decode("ascii", errors="replace")
    flag, dimensions = struct.unpack_from(f"{order}I", flags)[0], np.frombuffer(shape, f"{order}i4")
    if len(dimensions) != 2 or flag & _IS_COMPLEX:
        return
    kind = flag & 0xFF
    if _FIRST_NUMERIC <= kind <= _LAST_NUMERIC:
        real = next(parts, None)
        if real is not None and real.kind in _NUMBERS:
            values = np.frombuffer(real.data, f"{order}{_NUMBERS[real.kind]}")
            # In the machine's own byte order, as everything behind expects.
            yield label, values.reshape(tuple(dimensions), order="F").astype(values.dtype.newbyteorder("="))
    elif kind == _STRUCTURE and tuple(dimensions) == (1, 1) and depth < DEEPEST:
        yield from _fields(parts, order, label, depth)


def _fields(parts: Iterator[_Element], order: str, label: str, depth: int) -> Iterator[tuple[str, NDArray[Any]]]:
    width, names = next(parts, None), next(parts, None)
    if width is None or names is None:
        return
    (length,) = struct.unpack_from(f"{order}i", width.data)
    if length < 1:
        raise ValueError("the names of a structure's fields have no length")
    text = bytes(names.data)
    for start in range(0, len(text), length):
        field = text[start : start + length].split(b"\x00")[0].decode("ascii", errors="replace")
        value = next(parts, None)
        if value is None or value.kind != _MATRIX:
            raise ValueError("a field of a structure has no value")
        yield from _matrix(value.data, order, f"{label}.{field}", depth + 1)
