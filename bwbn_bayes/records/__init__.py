"""Records: what was measured, its files, excitations and noise."""

from typing import TYPE_CHECKING

from bwbn_bayes.lazily import importer

if TYPE_CHECKING:
    from bwbn_bayes.records.band import NoiseBand, noise_band
    from bwbn_bayes.records.cycles import HalfCycle, half_cycles, repeats
    from bwbn_bayes.records.excitation import (
        Envelope,
        el_centro,
        filtered_noise,
        ground_motion_density,
        sine,
    )
    from bwbn_bayes.records.noise import add_noise, model_free_noise_sd, noise_sds
    from bwbn_bayes.records.readers import (
        as_dataset,
        read_at2,
        read_csv,
        read_netcdf,
        read_record,
        write_csv,
        write_netcdf,
        write_record,
    )
    from bwbn_bayes.records.record import Record, si_unit

__all__ = [
    "Envelope",
    "HalfCycle",
    "NoiseBand",
    "Record",
    "add_noise",
    "as_dataset",
    "el_centro",
    "filtered_noise",
    "ground_motion_density",
    "half_cycles",
    "model_free_noise_sd",
    "noise_band",
    "noise_sds",
    "read_at2",
    "read_csv",
    "read_netcdf",
    "read_record",
    "repeats",
    "si_unit",
    "sine",
    "write_csv",
    "write_netcdf",
    "write_record",
]

__getattr__ = importer(
    {
        "bwbn_bayes.records.band": ("NoiseBand", "noise_band"),
        "bwbn_bayes.records.cycles": ("HalfCycle", "half_cycles", "repeats"),
        "bwbn_bayes.records.excitation": ("Envelope", "el_centro", "filtered_noise", "ground_motion_density", "sine"),
        "bwbn_bayes.records.noise": ("add_noise", "model_free_noise_sd", "noise_sds"),
        "bwbn_bayes.records.readers": (
            "as_dataset",
            "read_at2",
            "read_csv",
            "read_netcdf",
            "read_record",
            "write_csv",
            "write_netcdf",
            "write_record",
        ),
        "bwbn_bayes.records.record": ("Record", "si_unit"),
    }
)
