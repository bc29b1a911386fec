"""The one fit: what sensors saw of test points, a forward model asked for each, least squares between."""
