"""Versions of this package and of others."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version


def version_of(package: str = "bwbn-bayes") -> str:
    """Version of an installed package, or that it is none: sources that are only on Python's path have no version."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
