"""What every test runs under: the same examples every time, and a terminal that adds nothing to what is printed."""

import os

from hypothesis import settings

settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")

for _name in ("COLUMNS", "FORCE_COLOR", "GITHUB_ACTIONS"):
    os.environ.pop(_name, None)
