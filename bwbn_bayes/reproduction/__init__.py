"""The seed paper's tables, run again beside the printed figures."""
