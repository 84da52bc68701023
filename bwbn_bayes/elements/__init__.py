"""Storey laws: the Bouc-Wen element, the effects that extend it, and how they combine.

What the author of an effect needs stands here: a class of :class:`Effect` fills :class:`Slots` with expressions of
:data:`DRIFT`, :data:`DRIFT_RATE`, :data:`HYSTERETIC_DISPLACEMENT`, :data:`ENERGY`, :data:`PATH` and its parameters'
symbols; a :class:`SearchGuide` beside it lets ``discover`` look for it.
"""

from bwbn_bayes.elements.catalogue import register
from bwbn_bayes.elements.law import (
    DRIFT,
    DRIFT_RATE,
    ENERGY,
    HYSTERETIC_DISPLACEMENT,
    PATH,
    AddedState,
    Effect,
    Event,
    Slots,
    symbol,
)
from bwbn_bayes.elements.scales import Scales
from bwbn_bayes.elements.search_guide import SearchGuide, guides
from bwbn_bayes.elements.signature import PlaceResponse, Signature
from bwbn_bayes.parameters import Parameter

__all__ = [
    "DRIFT",
    "DRIFT_RATE",
    "ENERGY",
    "HYSTERETIC_DISPLACEMENT",
    "PATH",
    "AddedState",
    "Effect",
    "Event",
    "Parameter",
    "PlaceResponse",
    "Scales",
    "SearchGuide",
    "Signature",
    "Slots",
    "guides",
    "register",
    "symbol",
]
