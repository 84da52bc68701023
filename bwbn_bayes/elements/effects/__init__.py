"""One physical effect per file."""

from bwbn_bayes.elements.effects.appendage import Appendage
from bwbn_bayes.elements.effects.asymmetry import Asymmetry
from bwbn_bayes.elements.effects.backlash import Backlash
from bwbn_bayes.elements.effects.base_flexibility import BaseFlexibility
from bwbn_bayes.elements.effects.coulomb_friction import CoulombFriction
from bwbn_bayes.elements.effects.cubic_stiffness import CubicStiffness
from bwbn_bayes.elements.effects.foliente_pinching import FolientePinching
from bwbn_bayes.elements.effects.gap_impact import GapImpact
from bwbn_bayes.elements.effects.hysteresis import Hysteresis
from bwbn_bayes.elements.effects.input_scale import InputScale
from bwbn_bayes.elements.effects.mass_damping import MassDamping
from bwbn_bayes.elements.effects.mass_error import MassError
from bwbn_bayes.elements.effects.maxwell_branch import MaxwellBranch
from bwbn_bayes.elements.effects.p_delta import PDelta
from bwbn_bayes.elements.effects.quadratic_damping import QuadraticDamping
from bwbn_bayes.elements.effects.sensor_bias import SensorBias
from bwbn_bayes.elements.effects.sensor_gain import SensorGain
from bwbn_bayes.elements.effects.sensor_lag import SensorLag
from bwbn_bayes.elements.effects.sliding_base import SlidingBase
from bwbn_bayes.elements.effects.slip_lock import SlipLock
from bwbn_bayes.elements.effects.stiffness_degradation import StiffnessDegradation
from bwbn_bayes.elements.effects.storey_coupling import StoreyCoupling
from bwbn_bayes.elements.effects.storey_parameter import StoreyParameter
from bwbn_bayes.elements.effects.strength_degradation import StrengthDegradation
from bwbn_bayes.elements.effects.sudden_damage import SuddenDamage
from bwbn_bayes.elements.effects.viscous_damper import ViscousDamper

__all__ = [
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
]
