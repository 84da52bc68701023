"""Names of the engines, known without loading any."""

NAMES = ("lanes", "cvodes", "reference", "scalar", "sunode", "cuda")
"""Every engine, the default first."""
