"""Three storeys on friction pendulums, under twice El Centro: a linear frame on a slab that slides.

All sliders together are one link, storey 1, and carry the whole weight. Units: N, m, s, kg, J.
"""

from bwbn_bayes import FrictionPendulum, Linear, ShearBuilding, Uniform, el_centro

masses = [6e4, 5e4, 5e4, 4e4]  # kg, the slab on the sliders first
weight = 9.81 * sum(masses)  # N

model = ShearBuilding(
    masses=masses,
    isolator=FrictionPendulum(
        W=weight,
        R=Uniform(0.5, 5.0),  # m
        mu_slow=Uniform(0.01, 0.1),
        mu_fast=Uniform(0.02, 0.2),
        a_mu=Uniform(5, 100),  # s/m
        Y=0.0005,  # m
    ),
    storey=Linear(
        k=Uniform(2e7, 4e8),  # N/m
        c=Uniform(0, 2e6),  # N s/m
    ),
)

excitation = el_centro("chopra", duration=20.0, scale=2.0)
snr_db = 30.0  # dB of mean square
truth = {
    "R[1]": 1.55,  # a period of 2.5 s
    "mu_slow[1]": 0.03,
    "mu_fast[1]": 0.06,
    "a_mu[1]": 30.0,
    "k[2,3,4]": 9e7,
    "c[2,3,4]": 3e5,
}
assumptions = (
    "The building is invented; radius and friction are of the size of sliders that are built.",
    "The weight on the sliders and the contact's yield displacement are known; the weight stays as the building moves.",
    "The ground motion is the first 20 s of El Centro 1940, north-south, as printed by Chopra, doubled.",
)
