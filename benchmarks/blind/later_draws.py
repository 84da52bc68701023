"""Effects that joined the catalogue after its table had been drawn from: that one does not grow, and neither may this.

Some are missing from a model of linear storeys: their buildings do not yield but for what is hidden, and discovery is
given a linear chain.
"""

from __future__ import annotations

from benchmarks.blind.draws import Draw, Hidden, Place, at_storey, in_whole


def _sliding_base(here: Place) -> Hidden:
    mass = here.dice.anywhere(0.5, 1.5)
    values = {
        "slipperiness": here.dice.size(1.2, 4.0) / here.at.base_shear,
        "slider_give": here.dice.anywhere(0.002, 0.01) * here.at.drift,
        # A pendulum of two to six times the building's own period under all floors and the slab.
        "pendulum": (mass + sum(p.mass for p in here.building.storeys))
        * (here.at.omegas[0] / here.dice.anywhere(2.0, 6.0)) ** 2,
        "base_mass": mass,
    }
    # Friction and radius of the catalogue go with a weight that it takes for known.
    return in_whole("sliding_base", values, {"m_s": mass})


def _hysteresis(here: Place) -> Hidden:
    """A share of the storey's spring yields, at 0.2 to 1.2 times the largest drift that the linear storey reaches."""
    share, n = here.dice.size(0.1, 0.9), here.dice.anywhere(1.0, 3.0)
    bend = (here.dice.anywhere(0.2, 1.2) * here.at.drift) ** -n
    gamma = here.dice.anywhere(-0.3, 0.5) * bend
    values = {"alpha": 1.0 - share, "beta": bend - gamma, "gamma": gamma, "n": n}
    return at_storey("hysteresis", here.storey, values, {"r_h": share, "n_h": n})


def _storey_coupling(here: Place) -> Hidden:
    coupling = here.dice.size(0.03, 0.5) * here.building.storeys[0].k
    return in_whole("storey_coupling", {"coupling": coupling}, {"k_bend": coupling})


LATER: dict[str, Draw] = {
    "sliding_base": _sliding_base,
    "hysteresis": _hysteresis,
    "storey_coupling": _storey_coupling,
}

OF_LINEAR: frozenset[Draw] = frozenset({_hysteresis})
"""Drawn in a building of linear storeys."""
