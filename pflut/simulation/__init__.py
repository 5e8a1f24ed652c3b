"""Simulations: correspondences, odometry, and a rendered home to drive through."""
