"""The same misfit and its gradient by others: what a PyMC user would take in the place of ``to_pymc``."""
