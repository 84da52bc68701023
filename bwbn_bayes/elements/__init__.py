"""Storey laws: the Bouc-Wen element, the effects that extend it, and how they combine."""
