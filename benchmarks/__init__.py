"""Benchmarks: each prints a table and writes JSON; ratios are measured side by side in one run."""
