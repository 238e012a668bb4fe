"""URDFs of sampled robots, as they may be built."""
