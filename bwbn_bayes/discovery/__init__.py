"""From a model and a record to the effect the model lacks: where they disagree, what it is, and the gap without it."""
