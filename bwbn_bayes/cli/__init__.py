"""The command line."""

from bwbn_bayes.cli.commands import main

__all__ = ["main"]
