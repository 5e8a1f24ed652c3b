"""Images to features, features to correspondences."""

from __future__ import annotations

from importlib import import_module
from typing import Any

_NAMES = {
    "FeatureCache": "cache",
    "FeatureExtractor": "extractor",
    "Features": "features",
    "match": "matching",
    "match_indices": "matching",
    "match_many": "matching",
    "read_image": "image",
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name not in _NAMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_NAMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(_NAMES)
