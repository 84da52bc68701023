"""Where Runge-Kutta steps are refined and where they end: the same rules in the lane and in the scalar engine.

An interval between two samples is cut into equal steps, more where an imposed displacement takes a long stride: by its
range always, and where steps are refined by the drift within which a loop settles (``bouc_wen.ShortStrides``). Near a
sharp feature of the law each step changes the state by at most ``resolution`` widths; some are sharp near a state's
zero, some wherever it is, and what is fast however little it moves limits the step's length itself. A step ends where a
drift rate is foretold to change sign, if the law has a kink there, unless the engine is told not to; and at every
event. What is decided for a draw depends on that draw alone.
"""

from __future__ import annotations

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from bwbn_bayes.elements.law import StoreyLaw
from bwbn_bayes.parameters import Floats

REACH = 5.0
"""Steps are refined within this many widths of a sharp feature. With 3 the error at the finest settings is ten times as
large, with 8 it is the same."""

MARGIN = 0.02
"""A change of sign closer than this share of a step to its ends does not cut it."""

MOST_STEPS = 64.0
"""Most steps that a sharp feature asks for between two samples."""

RANGE_STEPS = 100
"""Steps in which an imposed displacement passes from its least to its largest, per substep, however few samples it has
there: a digitised loop has some ten samples a half cycle, and a step longer than the yield displacement diverges."""


def interval_steps(excitation: Floats, substeps: int, *, driven: bool) -> NDArray[np.int64]:
    """Steps of each interval between two samples, ``(n_times,)``, before any refinement; the last counts for nothing.

    Parameters
    ----------
    excitation : (n_times,) array
        Ground acceleration [m/s^2], or where ``driven`` the imposed displacement [m].
    substeps : int
        Steps per interval at least.
    driven : bool
        Whether the excitation is a displacement: then its increments are the drift's, known beforehand.
    """
    least = np.full(len(excitation), substeps, dtype=np.int64)
    if driven and np.ptp(excitation) > 0.0:
        share = np.abs(np.diff(excitation)) / np.ptp(excitation)
        least[:-1] *= np.maximum(np.ceil(RANGE_STEPS * share), 1.0).astype(np.int64)
    return least


def has_kink(law: StoreyLaw, variable: sp.Symbol) -> bool:
    """Whether ``sign``, ``Abs`` or ``Heaviside`` in the law switches where the variable changes sign."""
    outputs = (law.force, *law.rates)
    switches = [switch for output in outputs for switch in output.atoms(sp.sign, sp.Abs, sp.Heaviside)]
    return any(variable in switch.free_symbols for switch in switches)


def steps_in_words(substeps: int, resolution: float) -> str:
    """The rules' settings, for reports."""
    refined = f", refined to {resolution:g} widths per step where the law is sharp" if resolution else ""
    return f"{substeps} step{'s' if substeps > 1 else ''} per sample{refined}"
