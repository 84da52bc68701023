"""Blind trials of discovery: an independent simulator, cases drawn from it, and the scoring of what discovery says.

Nothing here comes from ``bwbn_bayes.elements`` or ``bwbn_bayes.engines``: equations and integrator are their own.
"""
