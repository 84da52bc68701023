"""Engines by name, and what is available here."""

from __future__ import annotations

from dataclasses import dataclass

from bwbn_bayes.engines.base import Engine
from bwbn_bayes.engines.cuda import Cuda
from bwbn_bayes.engines.cuda_driver import first_card
from bwbn_bayes.engines.cvodes import Cvodes, load_library
from bwbn_bayes.engines.lanes import Lanes
from bwbn_bayes.engines.names import NAMES
from bwbn_bayes.engines.reference import Reference
from bwbn_bayes.engines.scalar import ScalarRk4
from bwbn_bayes.engines.sunode import Sunode, load_sunode
from bwbn_bayes.errors import UserError

_SUMMARIES = {
    "lanes": "the default: generated code that solves sixteen draws at once",
    "cvodes": "SUNDIALS CVODES with a compiled right-hand side and sensitivities under error control",
    "reference": "SciPy at tight tolerances: makes synthetic records and judges the others",
    "scalar": "the scheme of lanes, one draw at a time: for comparison",
    "sunode": "SUNDIALS CVODES by way of sunode (conda-forge), with adjoint gradients",
    "cuda": "the scheme of lanes on a graphics card of NVIDIA's, a thread for each draw: for thousands at once",
}


@dataclass(frozen=True, kw_only=True)
class EngineFacts:
    """What ``bwbn engines`` says of an engine.

    Attributes
    ----------
    name : str
        As in ``--engine``.
    available : bool
        Whether it can be used here.
    reason : str
        What it is; where it is not available, why not.
    """

    name: str
    available: bool
    reason: str


def engine(name: str, n_threads: int | None = None) -> Engine:
    """The engine of that name with its default settings.

    Parameters
    ----------
    name : str
        One of :data:`~bwbn_bayes.engines.names.NAMES`.
    n_threads : int, optional
        Threads over draws, for engines that use them; the engine's own default where left out.

    Raises
    ------
    UserError
        If the name is unknown or the engine is not available here.
    """
    if name not in NAMES:
        raise UserError(f"engine {name!r} is not known: choose one of {', '.join(NAMES)}")
    if name == "reference":
        return Reference()
    if name == "lanes":
        return Lanes() if n_threads is None else Lanes(n_threads=n_threads)
    if name == "cuda":
        first_card()
        return Cuda() if n_threads is None else Cuda(n_threads=n_threads)
    if name == "scalar":
        return ScalarRk4(n_threads=n_threads or 1)
    if name == "sunode":
        load_sunode()
        return Sunode()
    load_library()
    return Cvodes(n_threads=n_threads or 1)


def engines() -> tuple[EngineFacts, ...]:
    """What is available here, the default first."""
    return tuple(_facts(name) for name in NAMES)


def _facts(name: str) -> EngineFacts:
    try:
        engine(name)
    except UserError as error:
        return EngineFacts(name=name, available=False, reason=str(error))
    return EngineFacts(name=name, available=True, reason=_SUMMARIES[name])
