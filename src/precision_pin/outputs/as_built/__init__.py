"""URDFs of robots as they may be built."""
