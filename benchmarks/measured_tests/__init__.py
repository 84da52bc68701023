"""Parts of the benchmark on measured tests."""
