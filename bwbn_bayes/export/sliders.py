"""Friction pendulums whose friction depends on speed, in a building: OpenSees' ``flatSliderBearing`` beside a spring.

No uniaxial material has a friction that knows the speed. This element does, and its ``VelDependent`` [1]_ is our law,
``mu_fast - (mu_fast - mu_slow) exp(-a_mu |v|)``. It lies in a plane, between two nodes of its own at one place, which
move with those that the link joins and do not rotate; its weight is put on first and held. The dish is ``Elastic``
``W / R`` beside it. Contact is elastic, ``mu_slow W / Y``, and then slides at once, where ours gives way gradually:
the script says what that makes of the loop.

References
----------
.. [1] M. C. Constantinou, A. Mokha and A. Reinhorn, "Teflon Bearings in Base Isolation II: Modeling", J. Struct. Eng.
   116(2), 1990.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from bwbn_bayes.export.exportable import Link
from bwbn_bayes.export.laws import without_law
from bwbn_bayes.parameters import Floats

_FINER = 50
"""Points of a loop for each sample: a slider turns within a small part of a step of the record."""
_MOBILISED = 1.0 - 1e-15
"""Largest share of the friction: where it is one, ``atanh`` has no value."""
_STIFFER = 1e3
"""Stiffness along the weight and against rotation, by that of the contact: neither moves."""


@dataclass(frozen=True, kw_only=True)
class Slider:
    """The element of one link.

    Attributes
    ----------
    weight : float
        On it. [N]
    contact : float
        Stiffness before it slides. [N/m]
    friction : (float, float, float)
        At rest, at speed, and how fast it grows with speed [s/m].
    error : float
        Rms of what it misses of the link's force over the rms of that force.
    """

    weight: float
    contact: float
    friction: tuple[float, float, float]
    error: float

    @property
    def axial(self) -> float:
        """Stiffness along the weight [N/m]."""
        return _STIFFER * self.contact


def slider_of(link: Link, time_steps: Floats) -> Slider | None:
    """The element for a link that is a friction pendulum and has nothing else that OpenSees lacks; None for others.

    Parameters
    ----------
    link : Link
    time_steps : (n_times - 1,) array
        Between its samples. [s]
    """
    p = link.parameters
    if not (p.get("W", 0.0) > 0.0 and p.get("a_mu", 0.0) != 0.0) or without_law({**p, "a_mu": 0.0}, in_analysis=True):
        return None
    missed = _friction_missed(link, time_steps)
    error = float(np.sqrt(np.mean(np.square(missed)) / np.mean(np.square(link.force)))) if np.any(link.force) else 0.0
    friction = (p["mu_slow"], p["mu_fast"], p["a_mu"])
    return Slider(weight=p["W"], contact=p["mu_slow"] * p["W"] / p["Y"], friction=friction, error=error)


def _friction_missed(link: Link, time_steps: Floats) -> Floats:
    """Friction of a contact that slides at once less that of ours ``(n_times,)`` [N], along the drift.

    Both are exact for a drift that goes straight between points: ours is ``z = Y tanh(u / Y + a)`` while it slides on,
    and ``z = u + b`` on the way back to zero.
    """
    p = link.parameters
    times = np.concatenate([[0.0], np.cumsum(time_steps)])
    path = CubicHermiteSpline(times, link.drift, link.drift_rate)
    points = np.interp(np.arange((len(times) - 1) * _FINER + 1) / _FINER, np.arange(len(times)), times)
    growth = np.exp(-p["a_mu"] * np.abs(path(points, 1)))
    friction = p["W"] * (p["mu_fast"] - (p["mu_fast"] - p["mu_slow"]) * growth)
    steps = np.diff(path(points)) / p["Y"]
    rest = p["mu_slow"] * p["W"]
    missed, share, sudden = np.zeros(len(points)), 0.0, 0.0
    for i, (way, bound) in enumerate(zip(steps.tolist(), friction[1:].tolist(), strict=True), 1):
        sudden = min(max(sudden + rest * way, -bound), bound)
        step = way
        if share * step < 0.0:
            back = math.copysign(min(abs(share), abs(step)), step)
            share, step = share + back, step - back
        share = min(max(math.tanh(math.atanh(share) + step), -_MOBILISED), _MOBILISED)
        missed[i] = sudden - bound * share
    return missed[::_FINER]
