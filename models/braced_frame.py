"""Three storeys and a brace from the ground past the first floor to the second, under El Centro.

The brace is elastic: a link of another element, between two nodes that no storey joins. Units: N, m, s, kg, J.
"""

from bwbn_bayes import BoucWen, Linear, PerStorey, ShearBuilding, Uniform, el_centro

model = ShearBuilding(
    masses=[2e4, 2e4, 1.5e4],  # kg
    storey=BoucWen(
        k=PerStorey(Uniform(5e6, 4e7)),  # N/m
        c=Uniform(0, 3e5),  # N s/m
        alpha=Uniform(0.001, 0.3),
        A=1.0,
        beta=Uniform(1, 200),  # 1/m^n
        gamma=Uniform(-50, 200),  # 1/m^n
        n=1.0,
    ),
).with_link(Linear(k=Uniform(1e6, 2e7)), joins=(0, 2))  # from the ground to floor 2

excitation = el_centro("chopra", duration=20.0)
snr_db = 30.0  # dB of mean square
truth = {
    "k[1]": 2e7,
    "k[2]": 1.6e7,
    "k[3]": 1.2e7,
    "c[1,2,3]": 8e4,
    "alpha[1,2,3]": 0.1,
    "beta[1,2,3]": 60.0,
    "gamma[1,2,3]": 40.0,
    "k[4]": 6e6,
}
assumptions = (
    "The frame is invented; the brace takes about a fifth of the force at the ground and does not yield.",
    "The ground motion is the first 20 s of El Centro 1940, north-south, as printed by Chopra, unscaled.",
)
