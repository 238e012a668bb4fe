"""The distribution of the first-order error, by Fourier inversion."""
