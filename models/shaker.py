"""A mass on a spring that a shaker pushes with a random-phase multisine; the spring is taken for linear.

What the spring does more than that is for `bwbn discover` to find: the record's truth has none of it.
Units: N, m, s, kg.
"""

import numpy as np

from bwbn_bayes import Linear, Oscillator, Uniform, as_force, multisine

model = Oscillator(
    mass=2.0,  # kg
    spring=Linear(
        k=Uniform(2e4, 2e5),  # N/m
        c=Uniform(0, 100),  # N s/m
    ),
)

excitation = as_force(multisine(np.random.default_rng(1), (5.0, 100.0), 2048, 1 / 750, rms=50.0))  # N on the mass
snr_db = 40.0  # dB of mean square
truth = {"k": 8e4, "c": 12.0}
assumptions = ("The oscillator is invented; the shaker's force is measured and the ground stands still.",)
