"""The response surface: one row a test point, the one table that all later stages read."""
