"""Stiffness that falls with the work done on the hysteretic spring, with the path or with excursions."""

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
from bwbn_bayes.elements.loops import READABLE_LOSS, stiffness_lost_per_cycle
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import Signature
from bwbn_bayes.parameters import Parameter, Value

_EXCURSIONS = sp.Symbol("x_eta", real=True)
"""Excursions of the drift, each by what it does to the stiffness."""
_LOSSES: tuple[Loss, ...] = (
    LinearLoss(what="stiffness", delta="delta_eta"),
    SaturatingLoss(what="stiffness", limit="eta_inf", rate="p_eta"),
    FatigueLoss(
        what="stiffness", loss="eta_a", power="s_eta", exponent="q_eta", at="N_eta", reach="u_eta", state=_EXCURSIONS
    ),
)
_WITH_PATH = LinearLoss(what="stiffness", delta="theta_eta", driver=DRIFT_PATH)
_FREE = (
    StretchedLoss(what="stiffness", loss="eta_e", bend="b_eta", power="m_eta", at="E_eta"),
    StretchedLoss(what="stiffness", loss="eta_c", bend="a_eta", power="r_eta", at="U_eta", driver=DRIFT_PATH),
)


@dataclass(frozen=True, kw_only=True)
class StiffnessDegradation(Effect):
    """``eta = 1 + delta_eta epsilon`` divides the rate of the hysteretic displacement.

    Or, with ``eta_inf`` and ``p_eta``, up to a limit: ``eta = 1 + eta_inf (1 - exp(-p_eta epsilon))``.
    Or, with the other four, in a free shape: ``eta = 1 + eta_e W(epsilon) / W(E_eta)``,
    ``W(x) = 1 - exp(-b_eta (x/E_eta)^m_eta)``.
    Or, with ``theta_eta``, with the path: ``eta = 1 + theta_eta u_c``, ``du_c/dt = |v|``; with ``eta_c`` and its three
    likes in the free shape, of ``u_c`` in place of ``epsilon`` and ``U_eta`` in place of ``E_eta``.
    Or, with ``eta_a`` and its four likes, with excursions that count by their size:
    ``eta = 1 + eta_a (x_eta/N_eta)^(s_eta/(q_eta + 1))``, ``dx_eta/dt = (q_eta + 1) |v|/u_eta (|u|/u_eta)^q_eta``.

    Parameters
    ----------
    delta_eta : float, Prior or PerStorey, optional
        Loss of stiffness per unit of work. [1/J]
    eta_inf : float, Prior or PerStorey, optional
        What eta has grown by after much work.
    p_eta : float, Prior or PerStorey, optional
        Rate at which it grows with work: after ``1/p_eta`` it has grown by 63 % of ``eta_inf``. [1/J]
    eta_e : float, Prior or PerStorey, optional
        What eta has grown by at the work ``E_eta``.
    b_eta : float, Prior or PerStorey, optional
        How far it has saturated by then: near zero it is a power of the work.
    m_eta : float, Prior or PerStorey, optional
        Power of the work in the free shape.
    E_eta : float, optional
        Work at which ``eta_e`` is measured. [J]
    theta_eta : float, Prior or PerStorey, optional
        Loss of stiffness per unit of path. [1/m]
    eta_c : float, Prior or PerStorey, optional
        What eta has grown by at the path ``U_eta``.
    a_eta : float, Prior or PerStorey, optional
        How far it has saturated by then: near zero it is a power of the path.
    r_eta : float, Prior or PerStorey, optional
        Power of the path in the free shape.
    U_eta : float, optional
        Path at which ``eta_c`` is measured. [m]
    eta_a : float, Prior or PerStorey, optional
        What eta has grown by at ``N_eta`` excursions to the drift ``u_eta``.
    s_eta : float, Prior or PerStorey, optional
        Power of the drift in the loss by a first excursion.
    q_eta : float, Prior or PerStorey, optional
        Power of the drift by which further excursions count, less one: with a large one the largest alone count.
    N_eta : float, optional
        Excursions, one way each, at which ``eta_a`` is measured.
    u_eta : float, optional
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
       the pinch saturates so with work; that eta does is our use of the same function (``elements/degradation.py``).
    """

    delta_eta: Value | None = None
    eta_inf: Value | None = None
    p_eta: Value | None = None
    eta_e: Value | None = None
    b_eta: Value | None = None
    m_eta: Value | None = None
    E_eta: Value | None = None
    theta_eta: Value | None = None
    eta_c: Value | None = None
    a_eta: Value | None = None
    r_eta: Value | None = None
    U_eta: Value | None = None
    eta_a: Value | None = None
    s_eta: Value | None = None
    q_eta: Value | None = None
    N_eta: Value | None = None
    u_eta: Value | None = None

    elements: ClassVar[tuple[str, ...]] = ("bouc_wen", "hardening_bouc_wen")
    name: ClassVar[str] = "stiffness_degradation"
    summary: ClassVar[str] = "stiffness falls with the work done on the hysteretic spring, the path or excursions"
    source: ClassVar[str] = f"{LINEAR_SOURCE}; saturating: {SATURATING_SOURCE}; {PATH_SOURCE}; {FATIGUE_SOURCE}"
    residual: ClassVar[str] = "the period grows with the work done"
    confusable: ClassVar[str] = "slow damage, base flexibility"

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
        """Stiffness lost per cycle."""
        reached = self.loss.reached
        return Signature(
            measure="stiffness lost per cycle",
            plain_name="the slope of later loops (a law of stiffness)",
            reason="a tenth of a per cent of the stiffness lost per cycle: some three per cent in a test of thirty",
            size=lambda at: at.per_cycle(share_left(1.0 + reached(at))),
            least=0.001,
            of_loop=stiffness_lost_per_cycle,
            needs="two large half cycles of one direction",
            readable=READABLE_LOSS,
            is_shown=lambda drift, force: stiffness_lost_per_cycle(drift, force) >= READABLE_LOSS,
        )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Those of the form; their symbols tell the forms apart."""
        return self.loss.parameters

    @classmethod
    @override
    def neutral_forms(cls) -> tuple[Self, ...]:
        return (
            cls(delta_eta=0.0),
            cls(eta_inf=0.0, p_eta=1.0),
            cls(theta_eta=0.0),
            cls(eta_a=0.0, s_eta=1.0, q_eta=1.0, N_eta=1.0, u_eta=1.0),
        )

    @override
    def fill(self, slots: Slots) -> Slots:
        states = (*slots.added_states, *self.loss.states)
        return replace(slots, eta=slots.eta + self.loss.expression, added_states=states)


@guides(StiffnessDegradation)
class StiffnessDegradationSearch(SearchGuide[StiffnessDegradation]):
    """How a search looks for a loss of stiffness."""

    family: ClassVar[str] = DEGRADATION

    @override
    def priors(self, scales: Scales) -> tuple[StiffnessDegradation, ...]:
        return tuple(StiffnessDegradation(**priors_of(loss, scales)) for loss in _LOSSES)

    @override
    def starts(self, effect: StiffnessDegradation, scales: Scales) -> Mapping[str, tuple[float, ...]]:
        return starts_of(effect.loss, scales)

    @override
    def free_shapes(self, scales: Scales) -> tuple[Effect, ...]:
        return tuple(StiffnessDegradation(**priors_of(loss, scales)) for loss in _FREE)
