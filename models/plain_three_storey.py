"""Three storeys of the plain Bouc-Wen law, without degradation or pinching: a first model for a measured record.

It brings no record of its own; give one with ``--record FILE``. Units: N, m, s.
"""

from bwbn_bayes import BoucWen, PerStorey, ShearBuilding, Uniform

model = ShearBuilding(
    masses=[1.0, 1.0, 1.0],  # kg
    storey=BoucWen(
        k=PerStorey(Uniform(5, 60)),  # N/m
        c=PerStorey(Uniform(0, 0.5)),  # N s/m
        alpha=Uniform(0.001, 0.3),
        A=1.0,
        beta=Uniform(0.1, 8),
        gamma=Uniform(-4, 8),
        n=Uniform(1, 4),
    ),
)
