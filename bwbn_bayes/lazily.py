"""Public names that are imported from their homes on first use, so that a command pays for what it uses alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module


def importer(homes: Mapping[str, Sequence[str]]) -> Callable[[str], object]:
    """A module's ``__getattr__``.

    Parameters
    ----------
    homes : mapping of str to sequence of str
        Modules, and the names that each of them defines.
    """
    home_of = {name: home for home, names in homes.items() for name in names}

    def on_first_use(name: str) -> object:
        if name not in home_of:
            raise AttributeError(f"there is no public name {name!r}")
        return getattr(import_module(home_of[name]), name)

    return on_first_use
