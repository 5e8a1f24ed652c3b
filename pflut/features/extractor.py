"""From an image to its features."""

from __future__ import annotations

import hashlib
from dataclasses import KW_ONLY, dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pflut.camera.base import Camera
from pflut.features.distinct import distinct, unique_at_seam
from pflut.features.features import Features
from pflut.features.image import as_gray
from pflut.geometry import FloatArray

SIMILARITY_THRESHOLD = {"sift": 0.25, "orb": 0.1}
ORB_FEATURES = 1000
ORB_SCALE = np.float32(1.2)
SEAM_MARGIN = 1.5


@dataclass(frozen=True, eq=False)
class FeatureExtractor:
    """Find the features of images of one camera.

    Parameters
    ----------
    camera : Camera
        Gives the bearings; its image size is the only one accepted.
    detector : {"sift", "orb"}
        SIFT (Lowe 2004) or ORB (Rublee et al. 2011), OpenCV's.
    contrast_threshold : float
        SIFT's: lower finds more and weaker features. OpenCV's own default is 0.04.
    root_sift : bool
        Take the square roots of SIFT descriptors (Arandjelovic and Zisserman, "Three things
        everyone should know to improve object retrieval", CVPR 2012), so that Euclidean
        distances between them are Hellinger distances. Either way they are unit vectors.
    max_features : int, optional
        Keep this many with the strongest response. Without it SIFT keeps all and ORB, whose
        detector needs a number, 1000.
    similarity_threshold : float, optional
        Features of one image whose descriptors are nearer than this are dropped, see
        `pflut.features.distinct.distinct`; 0 keeps all. Without it 0.25 for SIFT (a distance of
        unit vectors; on photographs true matches have some 0.1 to 0.4, unrelated features 0.6
        to 1.0) and 0.1 for ORB (a share of the bits). That keeps some 90 % of the features of
        an empty home with its repeated windows and tiles, and 97 % of those of a street.
    mask_elevation : (float, float), optional
        Lowest and highest elevation in radians, in the robot frame, of the features to keep:
        leaves out a tripod, or the robot itself.
    mask : ndarray of shape (height, width), optional
        Zero (or False) where no features are wanted, in pixels of the image.

    Raises
    ------
    ValueError
        If an option is out of range.
    """

    camera: Camera
    _: KW_ONLY
    detector: str = "sift"
    contrast_threshold: float = 0.02
    root_sift: bool = True
    max_features: int | None = None
    similarity_threshold: float | None = None
    mask_elevation: tuple[float, float] | None = None
    mask: NDArray[Any] | None = None

    def __post_init__(self) -> None:
        if self.detector not in SIMILARITY_THRESHOLD:
            raise ValueError(f"detector: expected 'sift' or 'orb', got {self.detector!r}")
        if not 0.0 <= self.contrast_threshold < 1.0:
            raise ValueError(
                f"contrast_threshold: expected 0 <= t < 1, got {self.contrast_threshold!r}"
            )
        if self.max_features is not None and self.max_features < 1:
            raise ValueError(f"max_features: expected at least 1, got {self.max_features!r}")
        if self.similarity_threshold is None:
            object.__setattr__(self, "similarity_threshold", SIMILARITY_THRESHOLD[self.detector])
        elif not self.similarity_threshold >= 0.0:
            raise ValueError(
                f"similarity_threshold: expected at least 0, got {self.similarity_threshold!r}"
            )
        if self.mask_elevation is not None:
            low, high = map(float, self.mask_elevation)
            if not low < high:
                raise ValueError(f"mask_elevation: expected min < max, got {self.mask_elevation}")
            object.__setattr__(self, "mask_elevation", (low, high))
        if self.mask is not None:
            size = (self.camera.height, self.camera.width)
            if np.shape(self.mask) != size:
                raise ValueError(f"mask: expected shape {size}, got {np.shape(self.mask)}")
            object.__setattr__(self, "mask", (np.asarray(self.mask) != 0).astype(np.uint8))

    def __call__(self, image: NDArray[Any]) -> Features:
        """Find the features of an image.

        Parameters
        ----------
        image : ndarray of shape (height, width) or (height, width, 3), uint8
            Gray, or blue, green, red.

        Returns
        -------
        Features
            In the order of falling response; none of a black image.

        Raises
        ------
        ValueError
            If the image is not uint8 or has another size than the camera's.
        """
        gray = as_gray(image, self.camera.width, self.camera.height)
        keypoints, descriptors = self._detect(self._padded(gray))
        if not keypoints:
            return Features.empty(binary=self.detector == "orb")
        pixels, chosen = self._placed(keypoints)
        azimuth, elevation = self.camera.bearings(pixels)
        chosen &= np.isfinite(azimuth)
        if self.mask_elevation is not None:
            chosen &= (elevation >= self.mask_elevation[0]) & (elevation <= self.mask_elevation[1])
        response = np.array([keypoint.response for keypoint in keypoints], dtype=np.float32)
        # ties by the place, so that the order does not depend on the detector's threads
        order = np.lexsort((pixels[:, 0], pixels[:, 1], -response))
        order = order[chosen[order]]
        features = Features(
            azimuth[order],
            elevation[order],
            self._described(descriptors[order]),
            pixels[order].astype(np.float32),
            response[order],
        )
        assert self.similarity_threshold is not None  # set in __post_init__
        features = features[distinct(features, self.similarity_threshold)]
        return features if self.max_features is None else features[: self.max_features]

    @cached_property
    def settings(self) -> str:
        """A text that differs wherever the features of the same image may differ."""
        parts = []
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name == "mask" and value is not None:
                value = hashlib.sha256(value.tobytes()).hexdigest()
            parts.append(f"{item.name}={value!r}")
        return ", ".join(parts)

    @property
    def _padding(self) -> int:
        """Columns that are repeated beyond each side of a full panorama.

        Enough for the descriptors of all but the largest features, and for the 31 pixels that
        ORB leaves out along the border of every level.
        """
        width = self.camera.width
        least = 64 if self.detector == "sift" else 128
        return min(width, max(least, width // 16)) if self.camera.horizontally_periodic else 0

    def _padded(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        return np.pad(image, ((0, 0), (self._padding, self._padding)), mode="wrap")

    @cached_property
    def _detector_mask(self) -> NDArray[np.uint8] | None:
        """Where to look, so that no descriptor is computed in vain; elevations are rechecked."""
        if self.mask is None and self.mask_elevation is None:
            return None
        width, height = self.camera.width, self.camera.height
        mask = np.ones((height, width), np.uint8) if self.mask is None else self.mask.copy()
        if self.mask_elevation is not None:
            low, high = self.mask_elevation
            u = np.arange(width, dtype=np.float64)
            for v in range(height):
                _, elevation = self.camera.bearings(np.stack([u, np.full(width, v)], axis=1))
                # a pixel of slack: the detector rounds
                slack = np.pi / height
                mask[v] &= (elevation >= low - slack) & (elevation <= high + slack)
        return self._padded(mask)

    def _detect(self, padded: NDArray[np.uint8]) -> tuple[tuple[Any, ...], Any]:
        import cv2

        if self.detector == "sift":
            # without the precise upscale OpenCV's keypoints lie 1/4 pixel to the lower right
            detector = cv2.SIFT_create(  # type: ignore[attr-defined]
                contrastThreshold=self.contrast_threshold, enable_precise_upscale=True
            )
        else:
            detector = cv2.ORB_create(  # type: ignore[attr-defined]
                nfeatures=self.max_features or ORB_FEATURES, scaleFactor=float(ORB_SCALE)
            )
        keypoints, descriptors = detector.detectAndCompute(padded, self._detector_mask)
        return tuple(keypoints), descriptors

    def _placed(self, keypoints: tuple[Any, ...]) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Give the keypoints' pixels in the image, and which of them to keep at its seam."""
        pixels = np.array([keypoint.pt for keypoint in keypoints], dtype=np.float64)
        padding, width = self._padding, self.camera.width
        if self.detector == "orb":
            octave = np.array([keypoint.octave for keypoint in keypoints], dtype=np.float32)
            scale = (ORB_SCALE**octave).astype(np.float64)
            size = np.array([width + 2 * padding, self.camera.height])
            pixels = _from_orb_level(pixels, scale, size)
            margin = SEAM_MARGIN * scale  # whole pixels of its level
        else:
            margin = np.full(len(pixels), SEAM_MARGIN)
        if not padding:
            return pixels, np.ones(len(pixels), dtype=np.bool_)
        pixels[:, 0] -= padding
        likeness = np.array([(np.log(k.size), np.deg2rad(k.angle)) for k in keypoints])
        chosen = unique_at_seam(pixels, likeness, width, margin)
        pixels[:, 0] = (pixels[:, 0] + 0.5) % width - 0.5
        return pixels, chosen

    def _described(self, descriptors: NDArray[Any]) -> NDArray[Any]:
        """Give unit vectors of SIFT descriptors; ORB's bits as they are."""
        if self.detector == "orb":
            return np.asarray(descriptors)
        values = descriptors.astype(np.float64)
        if self.root_sift:
            values = np.sqrt(values)
        length = np.linalg.norm(values, axis=1, keepdims=True)
        return np.asarray(values / np.maximum(length, 1e-12), dtype=np.float32)


def _from_orb_level(pixels: FloatArray, scale: FloatArray, size: NDArray[np.int_]) -> FloatArray:
    """Correct where OpenCV places ORB's keypoints of higher pyramid levels.

    It multiplies a level's coordinates by the nominal scale. But levels are resized so that
    pixel borders coincide, not the centers of the first pixels, and to a rounded size: one to
    two pixels at the highest levels.
    """
    level_size = np.rint(size / scale[:, None])
    return np.asarray((pixels / scale[:, None] + 0.5) * (size / level_size) - 0.5)
