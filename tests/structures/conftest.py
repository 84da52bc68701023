"""Puts the storey-law laboratory and the reference numbers on the import path."""

import sys
from pathlib import Path

sys.path += [str(Path(__file__).parents[1] / directory) for directory in ("elements", "reference")]
