"""Three storeys of the plain Bouc-Wen law, and a record of a building that does something more.

The model is that of plain_three_storey.py. The record is El Centro 1940 on a building with an effect that this file
does not mention; the held-out record is the same building under another ground motion. Units: N, m, s.
"""

from pathlib import Path

from bwbn_bayes import BoucWen, PerStorey, ShearBuilding, Uniform, read_record

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

record = read_record(Path(__file__).with_name("hidden_effect.csv"))
held_out = read_record(Path(__file__).with_name("hidden_effect_held_out.csv"))
