"""What every test runs under: the same examples every time, and a terminal that adds nothing to what is printed.

One thread for linear algebra in each worker, and in what a test starts: the matrices are small, and threads that wait
for one another take a tenth of the time. What a test starts may keep bytecode, as a user's command does: a container
that forbids it would read the whole package anew in each of some hundred processes.
"""

import gc
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import pytest
from hypothesis import settings

settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")


def pytest_collection_finish() -> None:
    """Keep the collector from going through all that is imported by now, again and again."""
    gc.collect()
    gc.freeze()


for _name in ("COLUMNS", "FORCE_COLOR", "GITHUB_ACTIONS"):
    os.environ.pop(_name, None)


@pytest.fixture(scope="session")
def blank_figures() -> Callable[[], AbstractContextManager[None]]:
    """While it is open, figures are composed and stay blank: Matplotlib's rendering is nine tenths of a page's seconds.

    For pages whose words are looked at; ``tests/report`` renders every figure.
    """

    @contextmanager
    def blank() -> Iterator[None]:
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(FigureCanvasAgg, "draw", FigureCanvasAgg.get_renderer)
            yield

    return blank


@pytest.fixture
def undrawn(blank_figures: Callable[[], AbstractContextManager[None]]) -> Iterator[None]:
    """A test whose pages hold blank figures."""
    with blank_figures():
        yield
