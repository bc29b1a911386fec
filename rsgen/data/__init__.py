"""Data of a test: structure and observation, time histories, response surfaces, multisine spectra."""
