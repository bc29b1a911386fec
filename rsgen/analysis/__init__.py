"""A result to further numbers: comparison with the truth, frequency responses for other programs."""
