"""Matplotlib figures from results.

Every function returns a `matplotlib.figure.Figure` that belongs to nobody else: pyplot, its global
state and its choice of a window system are never touched, so all of it works without a display.
`save_figure` writes one; in a notebook the figure shows itself.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_NAMES = {
    "ParticleFrame": "animation",
    "animate_particles": "animation",
    "draw_map": "map",
    "plot_correspondences": "pair",
    "plot_error_against": "errors",
    "plot_errors": "errors",
    "plot_posterior": "pair",
    "plot_trajectory": "map",
    "save_figure": "style",
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name not in _NAMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_NAMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(_NAMES)
