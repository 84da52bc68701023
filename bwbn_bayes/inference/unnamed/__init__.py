"""What has no name: a force beyond the law, a link that a building lacks, an error of a sensor."""

UNNAMED_SCALE = 0.1
"""Standard deviation of the unnamed force's scale about zero, over the largest force: a law that leaves more is a
wrong law, not one with a force beside it."""
N_KINDS = 7
"""Kinds of a building's unnamed force, one of which it is, each as likely beforehand as the others: a function of one
state (drift, drift rate, hysteretic displacement), or to first order one of all of them, one that changes in time, one
of the other storeys' motion, or of no simple kind."""
