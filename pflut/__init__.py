"""pflut: visual Monte Carlo localization on the plane."""

__version__ = "0.1.0"
