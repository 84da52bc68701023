"""Write the two records of models/hidden_effect.py with the independent simulator.

``python -m benchmarks.blind.make_hidden_effect``

El Centro 1940 on a three-storey building whose second storey slips near the middle of its loops, more so the more work
it has done (Baber and Noori's series slip-lock): an effect that the model file does not mention. The held-out record is
the same building under filtered noise. Noise is white, 30 dB below the signal in mean square.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.blind.simulator import Building, respond
from benchmarks.blind.storey import Storey
from bwbn_bayes.records import Envelope, Record, add_noise, el_centro, filtered_noise, write_csv

FOLDER = Path(__file__).parents[2] / "models"
SNR_DB = 30.0
STIFFNESS = (34.0, 30.0, 26.0)  # N/m
SLIP = {"delta_s": 0.035, "sigma": 0.03}  # m/J, m
DECIMALS = 5  # of m/s^2: a thousandth of the noise


def building() -> Building:
    """Three storeys of 1 kg; the second one slips."""
    storeys = [Storey(k=k, c=0.2, alpha=0.12, beta=3.0, gamma=1.5, n=1.6) for k in STIFFNESS]
    slipping = Storey(k=STIFFNESS[1], c=0.2, alpha=0.12, beta=3.0, gamma=1.5, n=1.6, **SLIP)
    return Building(storeys=(storeys[0], slipping, storeys[2]))


def measured(motion: Record, name: str, rng: np.random.Generator) -> Record:
    """The building's floor accelerations under a ground motion, with noise, as an instrument would write them."""
    ground = np.round(motion.excitation, DECIMALS)
    clean = respond(building(), ground, motion.time_step).measured
    channels = {f"acceleration_{i}": signal for i, signal in enumerate(clean, start=1)}
    noisy = add_noise(
        Record(name=name, time_step=motion.time_step, excitation=ground, channels=channels), SNR_DB, rng
    ).channels
    return Record(
        name=name,
        time_step=motion.time_step,
        excitation=ground,
        channels={channel: np.round(signal, DECIMALS) for channel, signal in noisy.items()},
        provenance={"excitation": motion.name, "structure": "three-storey shear building, 1 kg each floor"},
    )


def main() -> None:
    """Write both files into models/."""
    rng = np.random.default_rng(1940)
    training = el_centro("chopra", scale=2.0)
    other = filtered_noise(rng, training.duration, training.time_step, peak=7.0, envelope=Envelope())
    write_csv(measured(training, "hidden_effect", rng), FOLDER / "hidden_effect.csv")
    write_csv(measured(other, "hidden_effect_held_out", rng), FOLDER / "hidden_effect_held_out.csv")


if __name__ == "__main__":
    main()
