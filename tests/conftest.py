"""What every test runs under: the same examples every time, and a terminal that adds nothing to what is printed.

One thread for linear algebra in each worker, and in what a test starts: the matrices are small, and threads that wait
for one another take a tenth of the time.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from hypothesis import settings

settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")

for _name in ("COLUMNS", "FORCE_COLOR", "GITHUB_ACTIONS"):
    os.environ.pop(_name, None)
