"""The seed paper's two other methods, a genetic algorithm and a radial basis network, beside the samplers."""
