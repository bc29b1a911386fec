"""A law with values to a motion: kernels, steady states, harmonic balance, virtual tests."""
