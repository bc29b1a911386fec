"""Motions of an oscillator m x'' + n(x, x') = f(t): steady states, harmonic balance, virtual tests."""
