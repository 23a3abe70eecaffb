"""Calibration, diagnosis and compensation of parallel robots from measured data."""

__version__ = "0.1.0"
