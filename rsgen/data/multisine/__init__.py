"""Tests with a periodic multisine: their spectra, best linear approximation, and periodic responses."""
