"""Makes the oracles and the calibration test of ``tests/inference`` importable by name."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
