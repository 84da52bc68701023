"""Truths from a model file's own prior, recorded by the independent simulator, and what is said of them."""
