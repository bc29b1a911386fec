"""Identify nonlinear springs and dampers from the response surface of a vibration test."""
