"""The unnamed force: what a structure does beyond its law, as a Gaussian process of force."""

UNNAMED_SCALE = 0.1
"""Standard deviation of the unnamed force's scale about zero, over the largest force: a law that leaves more is a
wrong law, not one with a force beside it."""
