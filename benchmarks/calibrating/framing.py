"""A model's numbers at one draw, as the independent simulator's frame; what that cannot follow is refused.

The package's table says which value stands at which link; the physics is the simulator's own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, replace

from benchmarks.blind.simulator import Building, Floats
from benchmarks.blind.storey import Storey
from benchmarks.calibrating.frame import Frame, Link
from bwbn_bayes.errors import UserError
from bwbn_bayes.structures.structure import Structure

_SPRING = {"k": 0.0, "c": 0.0, "alpha": 1.0, "A": 1.0, "n": 1.0}
"""A link without a hysteretic spring; models of such links alone have no other parameters."""
_SHAPES = ({"beta": 0.0, "gamma": 0.0}, {"u_y": 1.0, "rho": 0.5})
_PENDULUM = {"W": 0.0, "R": 1.0, "mu_slow": 0.0, "Y": 1.0, "mu_fast": 0.0, "a_mu": 0.0}
_OF_NODES = ("e_m", "gain", "bias")
_OF_ALL = ("c_m", "s_g")
_OF_LINKS = (
    *("delta_eta", "delta_nu", "delta_s", "sigma", "phi", "k3", "c2", "F_c", "v0", "k_g", "g", "k_m", "tau"),
    *("zeta_s", "p", "q", "psi_0", "delta_psi", "lambda_", "k_jump", "k_time"),
    *(f"{name}_{what}" for name in ("c", "delta_nu", "delta_eta", "delta_s") for what in ("jump", "time")),
)
"""Effects whose parameters have one name here and in the package."""


def frame_of(model: Structure, values: Floats) -> Frame:
    """The simulator's frame with a model's values ``(n_dim,)``.

    Raises
    ------
    UserError
        If the model has an effect, or a value of one, that the simulator does not follow.
    """
    table = model.table.local(values[None])[0].tolist()
    rows = [dict(zip((p.symbol for p in model.parameters), row, strict=True)) for row in table]
    _refuse_unknown(model, rows)
    n = model.n_floors
    return Frame(
        masses=tuple(m * (1.0 + row.get("e_m", 0.0)) for m, row in zip(model.masses, rows[:n], strict=True)),
        links=tuple(
            link_of(row, low, high, 0.0 if i >= n else model.masses[i])
            for i, (row, (low, high)) in enumerate(zip(rows, model.joints, strict=True))
        ),
        gains=tuple(row.get("gain", 1.0) for row in rows[:n]),
        biases=tuple(row.get("bias", 0.0) for row in rows[:n]),
        mass_damping=rows[0].get("c_m", 0.0),
        ground_factor=rows[0].get("s_g", 1.0),
    )


def link_of(row: Mapping[str, float], low: int, high: int, mass: float) -> Link:
    """A link between two nodes, its A taken into the other numbers.

    With ``z = A w`` the law of w has A = 1: ``beta A^(n-1)``, ``gamma A^(n-1)``, ``sigma / A``, and a hysteretic spring
    that is A times as stiff.
    """
    own = {**_SPRING, **{name: value for name, value in row.items() if name in _SPRING}}
    own |= {name: row[name] for name in _OF_LINKS if name in row}
    a, n, extra = own.pop("A"), own["n"], {}
    if row.get("W", 0.0) > 0.0:
        dish = {**_PENDULUM, **{name: value for name, value in row.items() if name in _PENDULUM}}
        own |= _pendulum(dish)
        extra = _speed(dish) if "mu_fast" in row else {}
        return Link(**own, **extra, low=low, high=high, mass=mass, width=dish["Y"])
    hysteretic, elastic = (1.0 - own["alpha"]) * own["k"], own["alpha"] * own["k"]
    stiffer = (elastic + a * hysteretic) / own["k"] if own["k"] > 0.0 else 1.0
    own["k"], own["alpha"] = own["k"] * stiffer, own["alpha"] / stiffer
    beta, gamma = _shape(row, a, n)
    own |= {"beta": beta * a ** (n - 1.0), "gamma": gamma * a ** (n - 1.0)}
    powers = {"sigma": -1.0, "psi_0": -1.0, "delta_psi": -1.0, "q": -1.0 / n, "phi": n - 1.0}
    own |= {name: own[name] * a**power for name, power in powers.items() if name in own}
    if "k_jump" in own:
        own["k_jump"] *= stiffer
    slips = own.get("delta_s", 0.0) != 0.0 or own.get("delta_s_jump", 0.0) != 0.0
    return Link(**own, low=low, high=high, mass=mass, width=own["sigma"] if slips else 1e9)


def building_of(model: Structure, frame: Frame) -> Building:
    """The same as the chain of storeys of the blind trials, which knows more effects.

    Raises
    ------
    UserError
        If the model is none, or has what that simulator lacks.
    """
    names = [item.name for item in fields(Storey)]
    bare = Frame(masses=tuple(model.masses), links=frame.links, gains=(1.0,) * model.n_floors)
    of_storeys = not any(map(has_more_than_a_storey, frame.links))
    if not model.is_chain or not of_storeys or frame != replace(bare, biases=(0.0,) * model.n_floors):
        raise UserError("wrong models are drawn of chains of storeys alone, without sliders and jumps of their numbers")
    return Building(storeys=tuple(Storey(**{name: getattr(p, name) for name in names}) for p in frame.links))


def has_more_than_a_storey(link: Link) -> bool:
    """Whether numbers of a link jump, or its friction grows with speed: what the blind trials' storey knows not."""
    names = {item.name for item in fields(Storey)} | {"low", "high", "width"}
    return any(getattr(link, item.name) != item.default for item in fields(Link) if item.name not in names)


def _refuse_unknown(model: Structure, rows: list[dict[str, float]]) -> None:
    known = {*_SPRING, *_PENDULUM, *_OF_NODES, *_OF_ALL, *_OF_LINKS}.union(*_SHAPES)
    others = [p for p in model.parameters if p.symbol not in known]
    unknown = [p.symbol for p in others if any(row[p.symbol] != p.neutral for row in rows)]
    if unknown:
        raise UserError(f"the independent simulator does not know {', '.join(unknown)}: no truth can be recorded")


def _shape(row: Mapping[str, float], a: float, n: float) -> tuple[float, float]:
    """``beta`` and ``gamma``, from the drift at which the first slope meets the bound of z where that is given."""
    if "u_y" not in row:
        return row.get("beta", 0.0), row.get("gamma", 0.0)
    both = a / (a * row["u_y"]) ** n
    return row["rho"] * both, (1.0 - row["rho"]) * both


def _pendulum(dish: Mapping[str, float]) -> dict[str, float]:
    """``W u / R + mu_slow W z / Y`` with ``dz/dt = (1 - (z / Y)^2 (sgn(z v) + 1) / 2) v``."""
    dish_spring, contact = dish["W"] / dish["R"], dish["mu_slow"] * dish["W"] / dish["Y"]
    k, half = dish_spring + contact, 0.5 / math.pow(dish["Y"], 2)
    return {"k": k, "alpha": dish_spring / k, "beta": half, "gamma": half, "n": 2.0}


def _speed(dish: Mapping[str, float]) -> dict[str, float]:
    """``mu = mu_fast - (mu_fast - mu_slow) exp(-a_mu |v|)`` beyond ``mu_slow``."""
    more = (dish["mu_fast"] - dish["mu_slow"]) * dish["W"] / dish["Y"]
    return {"speed_stiffness": more, "speed_growth": dish["a_mu"]}
