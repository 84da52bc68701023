"""The lane kernel of a law: generated, compiled and cached once, whichever threads ask."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import cache

from bwbn_bayes.elements.law import StoreyLaw
from bwbn_bayes.engines.kernel import Kernel, kernel_path
from bwbn_bayes.engines.lane_source import LaneLayout, lane_layout, lane_source, summary_source
from bwbn_bayes.engines.scalar import has_programs, programs_of


def kernel_of(law: StoreyLaw, driven: bool, single: bool = False) -> tuple[Kernel, LaneLayout]:
    """The compiled kernel of a law and the layout of its rows; made once, whichever threads ask."""
    with _MAKING:
        return _made(law, driven, single)


@cache
def _made(law: StoreyLaw, driven: bool, single: bool) -> tuple[Kernel, LaneLayout]:
    safe, programs = programs_of(law)
    return Kernel("lanes", lane_source(safe, programs, driven=driven, single=single)), lane_layout(safe, programs)


_MAKING = threading.Lock()


@cache
def summarise(single: bool) -> Callable[..., None]:
    """Sums what a kernel stored."""
    return Kernel("sums", summary_source(single=single)).functions("summarise").summarise


def is_compiled(law: StoreyLaw, driven: bool, *, single: bool = False) -> bool:
    """Whether the cache holds the law's kernel, or another process has begun to compile it; generates nothing."""
    if not has_programs(law):
        return False
    safe, programs = programs_of(law)
    path = kernel_path("lanes", lane_source(safe, programs, driven=driven, single=single))
    return path is not None and path.exists()


def compile_law(law: StoreyLaw, driven: bool, with_tangents: bool, *, single: bool = False) -> None:
    """Compile a law's kernel into the cache."""
    kernel, _ = kernel_of(law, driven, single)
    summarise(single)
    for march in (kernel.run, kernel.run_with_tangents) if with_tangents else (kernel.run,):
        assert march is not None
