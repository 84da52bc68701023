"""Every structure that can be built is written as a model file that builds it again."""

from __future__ import annotations

import numpy as np
import pytest
from test_topology import BRACED, TOWERS

from bwbn_bayes import (
    BoucWen,
    CoulombFriction,
    FrictionPendulum,
    HalfNormal,
    InitialState,
    Linear,
    Normal,
    Oscillator,
    PerStorey,
    QuadraticDamping,
    ShearBuilding,
    Specimen,
    StoreyCoupling,
    Uniform,
)
from bwbn_bayes.structures.model_source import ModelWriter
from bwbn_bayes.structures.parts import Links
from bwbn_bayes.structures.structure import Structure

YIELDING = BoucWen(k=PerStorey(Uniform(30, 70)), c=0.4, alpha=0.1, beta=8.0, gamma=4.0, n=1.4)
LINEAR = Linear(k=Uniform(10.0, 20.0), c=1.0 / 3.0)
SLIDER = FrictionPendulum(W=10.0, R=Uniform(1, 2), mu_slow=0.05, mu_fast=0.1, a_mu=20.0)
MASSES = [2.0, 1.5, 1.0]
CHAIN = ShearBuilding(masses=MASSES, storey=YIELDING, heights=[3.0, 3.0, 2.5])
ISOLATED = ShearBuilding(masses=MASSES, storey=LINEAR, isolator=SLIDER)
MIXED = Structure(
    masses=MASSES,
    heights=[3.0, 3.0, 2.5],
    links=tuple(
        Links(element=one, joins=((i, i + 1),))
        for i, one in enumerate((LINEAR, BoucWen(k=50.0, beta=8.0, gamma=-1.0, hardens=True), SLIDER))
    ),
)
STRUCTURES = {
    "chain": CHAIN,
    "braced": BRACED,
    "braced, heights": CHAIN.with_link(LINEAR, joins=(0, 2)).with_link(YIELDING, joins=(1, 3)),
    "braces that share their values": Structure(
        masses=MASSES, links=(*CHAIN.links, Links(element=LINEAR, joins=((0, 2), (1, 3))))
    ),
    "towers": TOWERS.with_effect(StoreyCoupling(k_bend=Uniform(0, 5))),
    "two towers on the ground": Structure(
        masses=[1.0, 1.0], links=(Links(element=YIELDING, joins=((0, 1), (0, 2))),), heights=[3.0, 3.0]
    ),
    "mixed": MIXED,
    "isolated": ISOLATED,
    "isolated, braced": ISOLATED.with_link(LINEAR, joins=(1, 3)),
    "specimen": Specimen(storey=YIELDING),
    "oscillator": Oscillator(mass=2.0, spring=LINEAR).with_effect(InitialState(u_0=Normal(0, 0.1))),
    "numbers of NumPy": CHAIN.with_effect(
        CoulombFriction(F_c=np.float32(0.5), v0=np.float64(0.01)), storeys=np.arange(1, 3).tolist()
    ).with_effect(QuadraticDamping(c2=HalfNormal(np.int64(3))), storeys=tuple(np.arange(1, 4))),
    "oscillator on two links": Oscillator(mass=2.0, spring=YIELDING).with_link(LINEAR, joins=(0, 1)),
}


@pytest.mark.parametrize("name", STRUCTURES)
def test_a_structure_comes_back_from_its_source(name: str) -> None:
    """A tower, or storeys of several elements, ended `discover` in an error after the whole search."""
    model, writer = STRUCTURES[name], ModelWriter()
    blocks = [writer.structure(model), *(writer.placed(one) for one in model.effects)]
    source = "\n".join([*writer.header(), *blocks])
    read: dict[str, object] = {}
    exec(source, read)
    assert read["model"] == model
    assert max(map(len, source.splitlines())) <= 118
