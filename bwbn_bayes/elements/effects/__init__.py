"""One physical effect per file."""

from bwbn_bayes.elements.effects.foliente_pinching import FolientePinching
from bwbn_bayes.elements.effects.slip_lock import SlipLock
from bwbn_bayes.elements.effects.stiffness_degradation import StiffnessDegradation
from bwbn_bayes.elements.effects.strength_degradation import StrengthDegradation
from bwbn_bayes.elements.effects.sudden_damage import SuddenDamage

__all__ = ["FolientePinching", "SlipLock", "StiffnessDegradation", "StrengthDegradation", "SuddenDamage"]
