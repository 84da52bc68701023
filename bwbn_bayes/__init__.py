"""bwbn_bayes: Bayesian identification of degrading, pinching Bouc-Wen-Baber-Noori structures from measured records.

A public name is imported on first use: SymPy, SciPy and Matplotlib take seconds to load.
"""

from typing import TYPE_CHECKING

from bwbn_bayes.lazily import importer

if TYPE_CHECKING:
    from bwbn_bayes.baselines.genetic import GeneticSettings
    from bwbn_bayes.discovery.outcome import Discovery
    from bwbn_bayes.discovery.run import DiscoverySettings
    from bwbn_bayes.discovery.workflow import discover
    from bwbn_bayes.elements.bouc_wen import BoucWen
    from bwbn_bayes.elements.catalogue import register
    from bwbn_bayes.elements.effects import (
        Appendage,
        Asymmetry,
        Backlash,
        BaseFlexibility,
        CoulombFriction,
        CubicStiffness,
        FolientePinching,
        GapImpact,
        Hysteresis,
        InputScale,
        MassDamping,
        MassError,
        MaxwellBranch,
        PDelta,
        QuadraticDamping,
        SensorBias,
        SensorGain,
        SensorLag,
        SlidingBase,
        SlipLock,
        StiffnessDegradation,
        StoreyCoupling,
        StoreyParameter,
        StrengthDegradation,
        SuddenDamage,
        ViscousDamper,
    )
    from bwbn_bayes.elements.effects.backlash import FreeSlack, Slack
    from bwbn_bayes.elements.effects.cubic_stiffness import PowerSpring
    from bwbn_bayes.elements.effects.foliente_pinching import FreePinch
    from bwbn_bayes.elements.effects.free_friction import FreeFriction, SpeedFriction
    from bwbn_bayes.elements.effects.free_stop import FreeStop
    from bwbn_bayes.elements.effects.quadratic_damping import PowerDamper
    from bwbn_bayes.elements.effects.slip_lock import FreeSlip
    from bwbn_bayes.elements.friction_pendulum import FrictionPendulum
    from bwbn_bayes.elements.initial_state import InitialState
    from bwbn_bayes.elements.linear import Linear
    from bwbn_bayes.engines.simulation import periods_until_repeated, simulate
    from bwbn_bayes.errors import UserError
    from bwbn_bayes.identification import identify
    from bwbn_bayes.inference.likelihood import IntegratedNoise, KnownNoise, SampledNoise
    from bwbn_bayes.inference.pymc.model import to_pymc as to_pymc
    from bwbn_bayes.inference.settings import Settings
    from bwbn_bayes.parameters import HalfNormal, LogNormal, Normal, PerStorey, Uniform
    from bwbn_bayes.records.dataframe import as_dataframe, record_from_dataframe
    from bwbn_bayes.records.excitation import as_force, el_centro, filtered_noise, multisine, sine, sweep
    from bwbn_bayes.records.joined import join_records, periodic
    from bwbn_bayes.records.netcdf import as_dataset, record_from_dataset
    from bwbn_bayes.records.noise import add_noise
    from bwbn_bayes.records.readers import read_record, write_record
    from bwbn_bayes.records.record import Record
    from bwbn_bayes.report import write_discovery, write_report
    from bwbn_bayes.results import Result
    from bwbn_bayes.structures.oscillator import Oscillator
    from bwbn_bayes.structures.parts import Links
    from bwbn_bayes.structures.shear_building import ShearBuilding
    from bwbn_bayes.structures.specimen import Specimen
    from bwbn_bayes.structures.starting_model import starting_model
    from bwbn_bayes.structures.structure import Structure

__all__ = [
    "Appendage",
    "Asymmetry",
    "Backlash",
    "BaseFlexibility",
    "BoucWen",
    "CoulombFriction",
    "CubicStiffness",
    "Discovery",
    "DiscoverySettings",
    "FolientePinching",
    "FreeFriction",
    "FreePinch",
    "FreeSlack",
    "FreeSlip",
    "FreeStop",
    "FrictionPendulum",
    "GapImpact",
    "GeneticSettings",
    "HalfNormal",
    "Hysteresis",
    "InitialState",
    "InputScale",
    "IntegratedNoise",
    "KnownNoise",
    "Linear",
    "Links",
    "LogNormal",
    "MassDamping",
    "MassError",
    "MaxwellBranch",
    "Normal",
    "Oscillator",
    "PDelta",
    "PerStorey",
    "PowerDamper",
    "PowerSpring",
    "QuadraticDamping",
    "Record",
    "Result",
    "SampledNoise",
    "SensorBias",
    "SensorGain",
    "SensorLag",
    "Settings",
    "ShearBuilding",
    "Slack",
    "SlidingBase",
    "SlipLock",
    "Specimen",
    "SpeedFriction",
    "StiffnessDegradation",
    "StoreyCoupling",
    "StoreyParameter",
    "StrengthDegradation",
    "Structure",
    "SuddenDamage",
    "Uniform",
    "UserError",
    "ViscousDamper",
    "add_noise",
    "as_dataframe",
    "as_dataset",
    "as_force",
    "discover",
    "el_centro",
    "filtered_noise",
    "identify",
    "join_records",
    "multisine",
    "periodic",
    "periods_until_repeated",
    "read_record",
    "record_from_dataframe",
    "record_from_dataset",
    "register",
    "simulate",
    "sine",
    "starting_model",
    "sweep",
    "write_discovery",
    "write_record",
    "write_report",
]

_on_first_use = importer(
    {
        "bwbn_bayes.baselines.genetic": ("GeneticSettings",),
        "bwbn_bayes.identification": ("identify",),
        "bwbn_bayes.discovery.outcome": ("Discovery",),
        "bwbn_bayes.discovery.run": ("DiscoverySettings",),
        "bwbn_bayes.discovery.workflow": ("discover",),
        "bwbn_bayes.elements.bouc_wen": ("BoucWen",),
        "bwbn_bayes.elements.catalogue": ("register",),
        "bwbn_bayes.elements.friction_pendulum": ("FrictionPendulum",),
        "bwbn_bayes.elements.initial_state": ("InitialState",),
        "bwbn_bayes.elements.linear": ("Linear",),
        "bwbn_bayes.elements.effects": (
            "Appendage",
            "Asymmetry",
            "Backlash",
            "BaseFlexibility",
            "CoulombFriction",
            "CubicStiffness",
            "FolientePinching",
            "GapImpact",
            "Hysteresis",
            "InputScale",
            "MassDamping",
            "MassError",
            "MaxwellBranch",
            "PDelta",
            "QuadraticDamping",
            "SensorBias",
            "SensorGain",
            "SensorLag",
            "SlidingBase",
            "SlipLock",
            "StiffnessDegradation",
            "StoreyCoupling",
            "StoreyParameter",
            "StrengthDegradation",
            "SuddenDamage",
            "ViscousDamper",
        ),
        "bwbn_bayes.elements.effects.backlash": ("FreeSlack", "Slack"),
        "bwbn_bayes.elements.effects.cubic_stiffness": ("PowerSpring",),
        "bwbn_bayes.elements.effects.free_friction": ("FreeFriction", "SpeedFriction"),
        "bwbn_bayes.elements.effects.foliente_pinching": ("FreePinch",),
        "bwbn_bayes.elements.effects.free_stop": ("FreeStop",),
        "bwbn_bayes.elements.effects.quadratic_damping": ("PowerDamper",),
        "bwbn_bayes.elements.effects.slip_lock": ("FreeSlip",),
        "bwbn_bayes.engines.simulation": ("periods_until_repeated", "simulate"),
        "bwbn_bayes.errors": ("UserError",),
        "bwbn_bayes.inference.likelihood": ("IntegratedNoise", "KnownNoise", "SampledNoise"),
        "bwbn_bayes.inference.settings": ("Settings",),
        "bwbn_bayes.parameters": ("HalfNormal", "LogNormal", "Normal", "PerStorey", "Uniform"),
        "bwbn_bayes.records.dataframe": ("as_dataframe", "record_from_dataframe"),
        "bwbn_bayes.records.netcdf": ("as_dataset", "record_from_dataset"),
        "bwbn_bayes.records.excitation": ("as_force", "el_centro", "filtered_noise", "multisine", "sine", "sweep"),
        "bwbn_bayes.records.joined": ("join_records", "periodic"),
        "bwbn_bayes.records.noise": ("add_noise",),
        "bwbn_bayes.records.readers": ("read_record", "write_record"),
        "bwbn_bayes.records.record": ("Record",),
        "bwbn_bayes.report": ("write_discovery", "write_report"),
        "bwbn_bayes.results": ("Result",),
        "bwbn_bayes.structures.oscillator": ("Oscillator",),
        "bwbn_bayes.structures.parts": ("Links",),
        "bwbn_bayes.structures.shear_building": ("ShearBuilding",),
        "bwbn_bayes.structures.specimen": ("Specimen",),
        "bwbn_bayes.structures.starting_model": ("starting_model",),
        "bwbn_bayes.structures.structure": ("Structure",),
    }
)


def __getattr__(name: str) -> object:
    """A public name from its home; ``to_pymc``, which needs an extra, is none that ``import *`` asks for."""
    if name == "to_pymc":
        from bwbn_bayes.errors import require_installed

        require_installed("pymc", "to_pymc")
        from bwbn_bayes.inference.pymc.model import to_pymc

        return to_pymc
    return _on_first_use(name)
