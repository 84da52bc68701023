"""A cyclic test: one specimen in a testing machine, its force against an imposed displacement.

Written for a measured one, column UC20H of Sugano 1996 in the PEER Structural Performance Database (peer_153):
reinforced concrete, bending failure, 944 digitised points without time, 16 cycles up to 20.7 mm, 409 kN at most. The
test itself is not part of this file, which makes a record of its own; give yours with --record. Units: N, m, J.

The record must have the columns `displacement` and `force`, with their units, in the order of the test, from rest: some
thirty points a cycle, more where the loop bends. A column `time` is not needed; without one nothing that depends on
rate can be told.
"""

import numpy as np

from bwbn_bayes import BoucWen, LogNormal, Record, Specimen, Uniform

model = Specimen(
    storey=BoucWen(
        # Slope just after the reversals of the measured loops; two standard deviations are a factor of 7, since a law
        # without degradation answers to a softening test with a softer spring.
        k=LogNormal(2.4e8, 1.0),  # N/m
        c=0.0,  # without time there is no damping to tell
        # Slope after yield over the first one; below zero where the force falls as the displacement grows.
        alpha=Uniform(-0.3, 0.6),
        # k, A, alpha, u_y share one scale that no record tells: leave A at 1.
        A=1.0,
        # Peak force over that slope, 409 kN / 240 MN/m. Where yield is gradual it is up to four times as much; it ends
        # where nothing would yield any more.
        u_y=LogNormal(1.7e-3, 1.5).truncated(4e-5, 4e-2),  # m
        # beta / (beta + gamma): unloading is as stiff as the first loading at 0.5, near the bound 2 rho times.
        rho=Uniform(0.2, 2.5),
        # Sharpness of yield: 1 is gradual; beyond 6 the corner is sharper than a record shows.
        n=Uniform(1.0, 6.0),
    ),
)

amplitudes = 1e-3 * np.array([0.8, 1.35, 2, 3, 4, 4, 6, 6, 8, 8, 12, 12, 16, 16, 20.5])  # m, one a cycle
turns = np.concatenate([[0.0], *([a, -a] for a in amplitudes), [0.0]])
points_a_way = 30
path = np.interp(np.arange(points_a_way * (len(turns) - 1) + 1) / points_a_way, np.arange(len(turns)), turns)
excitation = Record(
    name="cycles of growing amplitude",
    time_step=1.0,  # counts points: there is no time
    has_time=False,
    excitation=path,
    excitation_kind="displacement",
)
snr_db = 40.0  # dB of mean square, about what digitising leaves
truth = {"k": 2e8, "alpha": 0.01, "u_y": 1.9e-3, "rho": 0.6, "n": 1.3}
assumptions = (
    "The specimen neither degrades nor pinches: that is what `bwbn discover` is to say of a measured one.",
    "The displacement is imposed exactly and is straight between points; the force is measured with noise.",
    "The test is quasi-static: the force has no part that depends on rate.",
)
