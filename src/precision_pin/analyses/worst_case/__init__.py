"""The largest error that bounded tolerances can make together."""
