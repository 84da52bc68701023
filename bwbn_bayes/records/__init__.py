"""Records: what was measured, its files, excitations and noise."""

from typing import TYPE_CHECKING

from bwbn_bayes.lazily import importer

if TYPE_CHECKING:
    from bwbn_bayes.records.at2 import read_at2
    from bwbn_bayes.records.band import NoiseBand, noise_band
    from bwbn_bayes.records.cycles import HalfCycle, half_cycles, repeats
    from bwbn_bayes.records.dataframe import as_dataframe, record_from_dataframe
    from bwbn_bayes.records.delimited import read_csv, write_csv
    from bwbn_bayes.records.excitation import (
        Envelope,
        el_centro,
        filtered_noise,
        ground_motion_density,
        sine,
    )
    from bwbn_bayes.records.netcdf import as_dataset, read_netcdf, record_from_dataset, write_netcdf
    from bwbn_bayes.records.noise import add_noise, model_free_noise_sd, noise_sds
    from bwbn_bayes.records.readers import RECORD_SUFFIXES, read_record, write_record
    from bwbn_bayes.records.record import Record, si_unit

__all__ = [
    "RECORD_SUFFIXES",
    "Envelope",
    "HalfCycle",
    "NoiseBand",
    "Record",
    "add_noise",
    "as_dataframe",
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
    "record_from_dataframe",
    "record_from_dataset",
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
        "bwbn_bayes.records.at2": ("read_at2",),
        "bwbn_bayes.records.dataframe": ("as_dataframe", "record_from_dataframe"),
        "bwbn_bayes.records.delimited": ("read_csv", "write_csv"),
        "bwbn_bayes.records.netcdf": ("as_dataset", "read_netcdf", "record_from_dataset", "write_netcdf"),
        "bwbn_bayes.records.readers": ("RECORD_SUFFIXES", "read_record", "write_record"),
        "bwbn_bayes.records.record": ("Record", "si_unit"),
    }
)
