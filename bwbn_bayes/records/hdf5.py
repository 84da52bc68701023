"""HDF5 files, netCDF-4 and MATLAB 7.3 among them: what is asked of one before its library opens it."""

from __future__ import annotations

import mmap
from pathlib import Path

import h5py

from bwbn_bayes.records.text import is_plain

_SIGNATURE, _HEAP = b"\x89HDF\r\n\x1a\n", b"GCOL\x01\0\0\0"


def require_hdf5(path: Path | str) -> None:
    """Raise what h5py raises (OSError, KeyError, RuntimeError) unless a file can be opened as HDF5.

    Where it cannot, h5netcdf leaves an object half made, which tells of it on stderr when it is collected.
    """
    require_heaps(path)
    with h5py.File(path, "r") as file:
        file.attrs.get("_nc3_strict")  # what h5netcdf asks before its object is whole


def require_heaps(path: Path | str) -> None:
    """Raise OSError where text in a file is kept so that HDF5 would look for its end for ever, without a word.

    It walks its heaps (collections of text and references) from object to object by the size that each states, also
    where that is none, or leads backwards.
    """
    if not is_plain(Path(path)):
        raise OSError(f"{path} is no plain file")
    if not Path(path).stat().st_size:
        return
    with Path(path).open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        width = _width_of_lengths(data)
        place = data.find(_HEAP)
        while place >= 0:
            if not _has_an_end(data, place, width):
                raise OSError(f"{path} is damaged: a heap at byte {place} has no end")
            place = data.find(_HEAP, place + 1)


def _width_of_lengths(data: mmap.mmap) -> int:
    """Bytes of a length, as the head of the file states them."""
    begins = data.find(_SIGNATURE)
    if begins < 0 or len(data) < begins + 16:
        return 8
    stated = data[begins + (14 if data[begins + 8] < 2 else 10)]
    return stated if stated in (2, 4, 8) else 8


def _has_an_end(data: mmap.mmap, place: int, width: int) -> bool:
    """Whether the objects of a heap follow each other within it."""
    head, own_head = _padded(8 + width), _padded(len(_HEAP) + width)
    end = min(len(data), place + int.from_bytes(data[place + 8 : place + 8 + width], "little"))
    at = place + own_head
    while at + head <= end:
        size = int.from_bytes(data[at + 8 : at + 8 + width], "little")
        is_free_space = data[at : at + 2] == b"\0\0"  # of which the size is with its head
        step = size if is_free_space else head + _padded(size)
        if not 0 < step <= end - at:
            return False
        at += step
    return True


def _padded(size: int) -> int:
    return -(-size // 8) * 8
