"""Distributions of von Mises on the circle and on the torus, and mixtures fitted to grids."""
