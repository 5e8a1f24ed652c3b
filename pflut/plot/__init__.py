"""Matplotlib figures from results.

Every function returns a `matplotlib.figure.Figure` that belongs to nobody else: pyplot, its global
state and its choice of a window system are never touched, so all of it works without a display.
`save_figure` writes one; in a notebook the figure shows itself.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pflut._lazy import lazy

if TYPE_CHECKING:
    from pflut.plot.animation import ParticleFrame as ParticleFrame
    from pflut.plot.animation import animate_particles as animate_particles
    from pflut.plot.calibration import plot_calibration as plot_calibration
    from pflut.plot.errors import plot_errors as plot_errors
    from pflut.plot.errors import plot_medians as plot_medians
    from pflut.plot.errors import plot_pair_errors as plot_pair_errors
    from pflut.plot.map import draw_map as draw_map
    from pflut.plot.map import plot_trajectory as plot_trajectory
    from pflut.plot.nodes import plot_node_probabilities as plot_node_probabilities
    from pflut.plot.pair import plot_correspondences as plot_correspondences
    from pflut.plot.pair import plot_posterior as plot_posterior
    from pflut.plot.places import plot_places as plot_places
    from pflut.plot.pose_graph import plot_pose_graph as plot_pose_graph
    from pflut.plot.reliability import plot_precision_recall as plot_precision_recall
    from pflut.plot.reliability import plot_reliability as plot_reliability
    from pflut.plot.style import save_figure as save_figure

_NAMES = {
    "ParticleFrame": "animation",
    "animate_particles": "animation",
    "draw_map": "map",
    "plot_calibration": "calibration",
    "plot_correspondences": "pair",
    "plot_errors": "errors",
    "plot_medians": "errors",
    "plot_node_probabilities": "nodes",
    "plot_pair_errors": "errors",
    "plot_pose_graph": "pose_graph",
    "plot_places": "places",
    "plot_posterior": "pair",
    "plot_precision_recall": "reliability",
    "plot_reliability": "reliability",
    "plot_trajectory": "map",
    "save_figure": "style",
}

__getattr__, __dir__, __all__ = lazy(__name__, _NAMES)
