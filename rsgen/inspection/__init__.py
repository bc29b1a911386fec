"""What a data file holds, and a guess of the case that would read it."""
