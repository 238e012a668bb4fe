"""Tables, verdict and report section of the sampled law."""
