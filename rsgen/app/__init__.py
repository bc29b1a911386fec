"""Commands and runs: the only place that prints or exits."""
