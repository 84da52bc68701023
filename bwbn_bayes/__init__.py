"""bwbn_bayes: Bayesian identification of degrading, pinching Bouc-Wen-Baber-Noori structures from measured records."""

from bwbn_bayes.elements.bouc_wen import BoucWen
from bwbn_bayes.elements.catalogue import register
from bwbn_bayes.elements.effects import (
    FolientePinching,
    SlipLock,
    StiffnessDegradation,
    StrengthDegradation,
    SuddenDamage,
)
from bwbn_bayes.engines.simulation import simulate
from bwbn_bayes.errors import UserError
from bwbn_bayes.inference.identify import Settings, identify
from bwbn_bayes.inference.likelihood import IntegratedNoise, KnownNoise, SampledNoise
from bwbn_bayes.parameters import HalfNormal, LogNormal, Normal, PerStorey, Uniform
from bwbn_bayes.records.excitation import el_centro, filtered_noise, sine
from bwbn_bayes.records.noise import add_noise
from bwbn_bayes.records.readers import read_record
from bwbn_bayes.records.record import Record
from bwbn_bayes.report import write_report
from bwbn_bayes.results import Result
from bwbn_bayes.structures.shear_building import ShearBuilding
from bwbn_bayes.structures.specimen import Specimen

__all__ = [
    "BoucWen",
    "FolientePinching",
    "HalfNormal",
    "IntegratedNoise",
    "KnownNoise",
    "LogNormal",
    "Normal",
    "PerStorey",
    "Record",
    "Result",
    "SampledNoise",
    "Settings",
    "ShearBuilding",
    "SlipLock",
    "Specimen",
    "StiffnessDegradation",
    "StrengthDegradation",
    "SuddenDamage",
    "Uniform",
    "UserError",
    "add_noise",
    "el_centro",
    "filtered_noise",
    "identify",
    "read_record",
    "register",
    "simulate",
    "sine",
    "write_report",
]
