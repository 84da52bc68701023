"""Three storeys of linear springs and dampers: whether a building yields is left to discover.

It brings no record of its own; give one with ``--record FILE``. Units: N, m, s.
"""

from bwbn_bayes import Linear, PerStorey, ShearBuilding, Uniform

model = ShearBuilding(
    masses=[1.0, 1.0, 1.0],  # kg
    storey=Linear(
        k=PerStorey(Uniform(5, 60)),  # N/m
        c=PerStorey(Uniform(0, 0.5)),  # N s/m
    ),
)
