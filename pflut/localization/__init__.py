"""Localization: motion models, resampling, the particle filter, sensor models, global search.

Submodules are imported where they are used: the ones with kernels bring Numba with them.
"""
