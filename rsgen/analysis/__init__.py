"""A result to further numbers: comparison with the truth and with other fits."""
