"""Strength that falls with the work done on the hysteretic spring, with the path or with excursions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self, override

import sympy as sp

from bwbn_bayes.elements.degradation import (
    DEGRADATION,
    DRIFT_PATH,
    FATIGUE_SOURCE,
    LINEAR_SOURCE,
    PATH_SOURCE,
    SATURATING_SOURCE,
    FatigueLoss,
    LinearLoss,
    Loss,
    SaturatingLoss,
    StretchedLoss,
    loss_of,
    priors_of,
    share_left,
    starts_of,
)
from bwbn_bayes.elements.law import Effect, Slots
from bwbn_bayes.elements.loops import READABLE_LOSS, strength_lost_per_cycle
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import Parameter, Value

_EXCURSIONS = sp.Symbol("x_nu", real=True)
"""Excursions of the drift, each by what it does to the strength."""
_LOSSES: tuple[Loss, ...] = (
    LinearLoss(what="strength", delta="delta_nu"),
    SaturatingLoss(what="strength", limit="nu_inf", rate="p_nu"),
    FatigueLoss(
        what="strength", loss="nu_a", power="s_nu", exponent="q_nu", at="N_nu", reach="u_nu", state=_EXCURSIONS
    ),
)
_WITH_PATH = LinearLoss(what="strength", delta="theta_nu", driver=DRIFT_PATH)
_FREE = (
    StretchedLoss(what="strength", loss="nu_e", bend="b_nu", power="m_nu", at="E_nu"),
    StretchedLoss(what="strength", loss="nu_c", bend="a_nu", power="r_nu", at="U_nu", driver=DRIFT_PATH),
)


@dataclass(frozen=True, kw_only=True)
class StrengthDegradation(Effect):
    """``nu = 1 + delta_nu epsilon`` multiplies the shape bracket, so that the loop closes earlier.

    Or, with ``nu_inf`` and ``p_nu``, up to a limit: ``nu = 1 + nu_inf (1 - exp(-p_nu epsilon))``.
    Or, with the other four, in a free shape: ``nu = 1 + nu_e W(epsilon) / W(E_nu)``,
    ``W(x) = 1 - exp(-b_nu (x/E_nu)^m_nu)``.
    Or, with ``theta_nu``, with the path: ``nu = 1 + theta_nu u_c``, ``du_c/dt = |v|``; with ``nu_c`` and its three
    likes in the free shape, of ``u_c`` in place of ``epsilon`` and ``U_nu`` in place of ``E_nu``.
    Or, with ``nu_a`` and its four likes, with excursions that count by their size:
    ``nu = 1 + nu_a (x_nu/N_nu)^(s_nu/(q_nu + 1))``, ``dx_nu/dt = (q_nu + 1) |v|/u_nu (|u|/u_nu)^q_nu``.

    Parameters
    ----------
    delta_nu : float, Prior or PerStorey, optional
        Loss of strength per unit of work. [1/J]
    nu_inf : float, Prior or PerStorey, optional
        What nu has grown by after much work.
    p_nu : float, Prior or PerStorey, optional
        Rate at which it grows with work: after ``1/p_nu`` it has grown by 63 % of ``nu_inf``. [1/J]
    nu_e : float, Prior or PerStorey, optional
        What nu has grown by at the work ``E_nu``.
    b_nu : float, Prior or PerStorey, optional
        How far it has saturated by then: near zero it is a power of the work.
    m_nu : float, Prior or PerStorey, optional
        Power of the work in the free shape.
    E_nu : float, optional
        Work at which ``nu_e`` is measured. [J]
    theta_nu : float, Prior or PerStorey, optional
        Loss of strength per unit of path. [1/m]
    nu_c : float, Prior or PerStorey, optional
        What nu has grown by at the path ``U_nu``.
    a_nu : float, Prior or PerStorey, optional
        How far it has saturated by then: near zero it is a power of the path.
    r_nu : float, Prior or PerStorey, optional
        Power of the path in the free shape.
    U_nu : float, optional
        Path at which ``nu_c`` is measured. [m]
    nu_a : float, Prior or PerStorey, optional
        What nu has grown by at ``N_nu`` excursions to the drift ``u_nu``.
    s_nu : float, Prior or PerStorey, optional
        Power of the drift in the loss by a first excursion.
    q_nu : float, Prior or PerStorey, optional
        Power of the drift by which further excursions count, less one: with a large one the largest alone count.
    N_nu : float, optional
        Excursions, one way each, at which ``nu_a`` is measured.
    u_nu : float, optional
        Drift of an excursion that counts as one. [m]

    Raises
    ------
    UserError
        If the parameters of one form, and no others, are not what is given.

    References
    ----------
    .. [1] T. T. Baber and Y.-K. Wen, "Random Vibration of Hysteretic, Degrading Systems", J. Eng. Mech. Div. 107(6),
       1981 (linear).
    .. [2] G. C. Foliente, "Hysteresis Modeling of Wood Joints and Structural Systems", J. Struct. Eng. 121(6), 1995:
       the pinch saturates so with work; that nu does is our use of the same function (``elements/degradation.py``).
    """

    delta_nu: Value | None = None
    nu_inf: Value | None = None
    p_nu: Value | None = None
    nu_e: Value | None = None
    b_nu: Value | None = None
    m_nu: Value | None = None
    E_nu: Value | None = None
    theta_nu: Value | None = None
    nu_c: Value | None = None
    a_nu: Value | None = None
    r_nu: Value | None = None
    U_nu: Value | None = None
    nu_a: Value | None = None
    s_nu: Value | None = None
    q_nu: Value | None = None
    N_nu: Value | None = None
    u_nu: Value | None = None

    elements: ClassVar[tuple[str, ...]] = ("bouc_wen", "hardening_bouc_wen")
    name: ClassVar[str] = "strength_degradation"
    summary: ClassVar[str] = "strength falls with the work done on the hysteretic spring, the path or excursions"
    source: ClassVar[str] = f"{LINEAR_SOURCE}; saturating: {SATURATING_SOURCE}; {PATH_SOURCE}; {FATIGUE_SOURCE}"
    residual: ClassVar[str] = "peaks are clipped more as work is done"
    confusable: ClassVar[str] = "falling n or beta"

    def __post_init__(self) -> None:
        _ = self.loss  # refuses what belongs to no form

    @cached_property
    def loss(self) -> Loss:
        """By which it is lost: the form whose parameters are given."""
        every = (*_LOSSES, *_FREE, _WITH_PATH)
        given = {p.symbol: getattr(self, p.symbol) for loss in every for p in loss.parameters}
        return loss_of(type(self).__name__, every, given)

    @property
    @override
    def form(self) -> str:
        return self.loss.form

    @property
    @override
    def signature(self) -> Signature:
        """Strength lost per cycle."""
        reached = self.loss.reached
        return Signature(
            measure="strength lost per cycle",
            plain_name="the height of later loops (a law of strength)",
            reason="a tenth of a per cent of the strength lost per cycle: some three per cent in a test of thirty",
            size=lambda at: at.per_cycle(share_left(1.0 + reached(at), power=1.0 / at["n"])),
            least=0.001,
            of_loop=strength_lost_per_cycle,
            needs="two large half cycles of one direction",
            readable=READABLE_LOSS,
            is_shown=lambda drift, force: strength_lost_per_cycle(drift, force) >= READABLE_LOSS,
        )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Those of the form; their symbols tell the forms apart."""
        return self.loss.parameters

    @classmethod
    @override
    def neutral_forms(cls) -> tuple[Self, ...]:
        return (
            cls(delta_nu=0.0),
            cls(nu_inf=0.0, p_nu=1.0),
            cls(theta_nu=0.0),
            cls(nu_a=0.0, s_nu=1.0, q_nu=1.0, N_nu=1.0, u_nu=1.0),
        )

    @override
    def fill(self, slots: Slots) -> Slots:
        states = (*slots.added_states, *self.loss.states)
        return replace(slots, nu=slots.nu + self.loss.expression, added_states=states)


@guides(StrengthDegradation)
class StrengthDegradationSearch(SearchGuide[StrengthDegradation]):
    """How a search looks for a loss of strength."""

    family: ClassVar[str] = DEGRADATION

    @override
    def priors(self, scales: Scales) -> tuple[StrengthDegradation, ...]:
        return tuple(StrengthDegradation(**priors_of(loss, scales)) for loss in _LOSSES)

    @override
    def starts(self, effect: StrengthDegradation, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return starts_of(effect.loss, scales)

    @override
    def free_shapes(self, scales: Scales) -> tuple[Effect, ...]:
        return tuple(StrengthDegradation(**priors_of(loss, scales)) for loss in _FREE)
