"""Likelihood, modes, samplers and what they say of a model and a record."""
