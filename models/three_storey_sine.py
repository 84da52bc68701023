"""The paper's three-storey building under a sine: degrading, pinching, damaged three times.

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
    sine,
)

DAMAGE_TIMES = PerStorey([30.0, 60.0, 100.0])  # s, storeys 1, 2 and 3 in turn

model = (
    ShearBuilding(
        masses=[1.0, 1.0, 1.0],  # kg
        storey=BoucWen(
            k=PerStorey(Uniform(5, 15)),
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
    .with_effect(SuddenDamage(parameter="delta_nu", jump=Uniform(0.1, 3), time=DAMAGE_TIMES))
    .with_effect(SuddenDamage(parameter="delta_eta", jump=Uniform(0.1, 3), time=DAMAGE_TIMES))
)

excitation = sine(amplitude=0.5, frequency_hz=0.2, duration=150.0, time_step=0.02)
snr_db = 30.0
truth = {
    **{f"k[{storey}]": 10.0 for storey in (1, 2, 3)},
    **{f"c[{storey}]": 0.05 for storey in (1, 2, 3)},
    "alpha": 0.01,
    "beta": 2.0,
    "gamma": 2.0,
    "n": 1.5,
    "delta_nu": 0.0,
    "delta_nu_jump": 1.5,
    "delta_eta": 0.0,
    "delta_eta_jump": 1.5,
    "delta_s": 0.05,
    "sigma": 0.01,
}
assumptions = (
    "The paper does not give the sine's amplitude or frequency: 0.5 m/s^2 and 0.2 Hz are taken.",
    "The paper does not say which storey is damaged when: storeys 1, 2 and 3 are damaged at 30, 60 and 100 s in turn.",
    "The signal-to-noise ratio is read as dB of mean square, for each channel by itself.",
    "The jumps of delta_nu and delta_eta add to their first values; the paper gives the values after the jump.",
)
