"""One storey under El Centro: eight parameters, a run of seconds; a model to start from.

The mass is 1 kg, so that forces read as accelerations. Units: N, m, s, J.
"""

from bwbn_bayes import BoucWen, ShearBuilding, StiffnessDegradation, StrengthDegradation, Uniform, el_centro

model = (
    ShearBuilding(
        masses=[1.0],  # kg
        storey=BoucWen(
            k=Uniform(20, 60),  # N/m
            c=Uniform(0.01, 1),  # N s/m
            alpha=Uniform(0.001, 0.3),
            A=1.0,
            beta=Uniform(1, 80),
            gamma=Uniform(-20, 60),
            n=Uniform(1, 3),
        ),
    )
    .with_effect(StrengthDegradation(delta_nu=Uniform(0, 2)))
    .with_effect(StiffnessDegradation(delta_eta=Uniform(0, 2)))
)

excitation = el_centro("chopra", duration=25.0)
snr_db = 30.0  # dB of mean square
truth = {
    "k": 40.0,
    "c": 0.2,
    "alpha": 0.05,
    "beta": 30.0,
    "gamma": 15.0,
    "n": 1.2,
    "delta_nu": 0.6,
    "delta_eta": 0.4,
}
assumptions = (
    "The building is invented: period 1 s, 1.6 % of critical damping, yield near a sixth of its weight.",
    "The ground motion is the first 25 s of El Centro 1940, north-south, as printed by Chopra, unscaled.",
)
