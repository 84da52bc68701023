"""Structures as parts of PyMC models; the only room that imports PyMC and PyTensor.

``operators`` wraps an engine as PyTensor operators with exact derivatives, ``densities`` makes log likelihoods of them,
``priors`` and ``model`` build a ``pm.Model`` from a structure and its records, ``smc`` and ``nuts`` run PyMC's samplers
on it, ``roads`` brings their draws back to :func:`~bwbn_bayes.inference.identify.identify`.
"""

from bwbn_bayes.inference.pymc.compile_folder import provide_compile_folder

provide_compile_folder()
