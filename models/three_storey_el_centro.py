"""The paper's three-storey building under El Centro: degrading, pinching, damaged three times.

Zhao, Noori, Altabey and Awad 2019, doi:10.3389/fbuil.2018.00080, table 1. A is fixed at 1, because it shares one scale
with k, alpha, beta, gamma and sigma.
"""

from bwbn_bayes import (
    BoucWen,
    PerStorey,
    ShearBuilding,
    SlipLock,
    StiffnessDegradation,
    StrengthDegradation,
    SuddenDamage,
    Uniform,
    el_centro,
)

DAMAGE_TIMES = PerStorey([10.0, 20.0, 40.0])  # s, storeys 1, 2 and 3 in turn

model = (
    ShearBuilding(
        masses=[1.0, 1.0, 1.0],  # kg
        storey=BoucWen(
            k=PerStorey(Uniform(15, 25)),
            c=PerStorey(Uniform(0.01, 0.1)),
            alpha=Uniform(0.001, 0.02),
            A=1.0,
            beta=Uniform(0.1, 4),
            gamma=Uniform(0.1, 4),
            n=Uniform(1, 2),
        ),
    )
    .with_effect(StrengthDegradation(delta_nu=Uniform(0, 0.1)))
    .with_effect(StiffnessDegradation(delta_eta=Uniform(0, 0.1)))
    .with_effect(SlipLock(delta_s=Uniform(0.01, 0.1), sigma=Uniform(0.001, 0.02)))
    .with_effect(SuddenDamage(parameter="delta_nu", jump=Uniform(0.1, 6), time=DAMAGE_TIMES))
    .with_effect(SuddenDamage(parameter="delta_eta", jump=Uniform(0.1, 6), time=DAMAGE_TIMES))
)

excitation = el_centro("rsn6_180")
snr_db = 30.0
truth = {
    **{f"k[{storey}]": 20.0 for storey in (1, 2, 3)},
    **{f"c[{storey}]": 0.05 for storey in (1, 2, 3)},
    "alpha": 0.01,
    "beta": 2.0,
    "gamma": 2.0,
    "n": 1.5,
    "delta_nu": 0.0,
    "delta_nu_jump": 3.0,
    "delta_eta": 0.0,
    "delta_eta_jump": 3.0,
    "delta_s": 0.05,
    "sigma": 0.01,
}
assumptions = (
    "The paper does not say which storey is damaged when: storeys 1, 2 and 3 are damaged at 10, 20 and 40 s in turn.",
    "The paper does not name the component or scale of El Centro: PEER's RSN 6, component 180, unscaled, is taken.",
    "The signal-to-noise ratio is read as dB of mean square, for each channel by itself.",
    "The jumps of delta_nu and delta_eta add to their first values; the paper gives the values after the jump.",
)
