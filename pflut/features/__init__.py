"""Images to features, features to correspondences."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pflut._lazy import lazy

if TYPE_CHECKING:
    from pflut.features.cache import FeatureCache as FeatureCache
    from pflut.features.extractor import FeatureExtractor as FeatureExtractor
    from pflut.features.features import Features as Features
    from pflut.features.image import read_image as read_image
    from pflut.features.matching import match as match
    from pflut.features.matching import match_indices as match_indices
    from pflut.features.matching import match_many as match_many

_NAMES = {
    "FeatureCache": "cache",
    "FeatureExtractor": "extractor",
    "Features": "features",
    "match": "matching",
    "match_indices": "matching",
    "match_many": "matching",
    "read_image": "image",
}

__getattr__, __dir__, __all__ = lazy(__name__, _NAMES)
