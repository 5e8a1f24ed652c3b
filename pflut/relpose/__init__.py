"""Relative poses of two views: one result type, and the estimators that return it."""
