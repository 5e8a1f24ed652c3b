"""pflut: visual Monte Carlo localization on the plane.

A look-up table of likelihoods, learned once, turns the point correspondences between the camera's
image and reference images taken at known poses into a full likelihood over relative poses; a
particle filter weights its poses with it. Names are imported when they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_NAMES = {
    "Correspondences": "correspondences",
    "CorrespondenceSimulator": "simulation.correspondences",
    "Dataset": "datasets.base",
    "DifferentialDrive": "localization.motion",
    "Estimate": "localization.estimate",
    "FeatureExtractor": "features",
    "Features": "features",
    "GlobalSearch": "localization.global_search",
    "GridPosterior": "posterior",
    "LikelihoodTable": "likelihood.table",
    "Localizer": "localization.localizer",
    "Omnidirectional": "localization.motion",
    "ParticleFilter": "localization.particle_filter",
    "ReferenceImageModel": "localization.reference_image_model",
    "ReferenceMap": "reference_map",
    "RelativePose": "relpose.result",
    "Trajectory": "trajectory",
    "estimate_relative_pose": "relpose.estimate",
    "load_camera": "camera",
    "load_dataset": "datasets",
    "match": "features",
    "match_many": "features",
    "pose_posterior": "posterior",
}

__all__ = ["__version__", *sorted(_NAMES)]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: `import pflut` stays fast."""
    if name not in _NAMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_NAMES[name]}"), name)


def __dir__() -> list[str]:
    return __all__
