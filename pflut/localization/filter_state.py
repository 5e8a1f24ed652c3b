"""All that a particle filter has become, to be saved and resumed to the last bit."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from pflut._files import checksum, read_arrays, replacing
from pflut.geometry import FloatArray, as_poses
from pflut.localization.weights import Weights

FORMAT = "pflut particle filter"
VERSION = 1
_ARRAYS = ("poses", "log_weights", "weights", "summary", "degenerate_updates")
_GENERATORS = ("PCG64", "PCG64DXSM", "MT19937", "Philox", "SFC64")


@dataclass(frozen=True, eq=False)
class FilterState:
    """Particles, weights and random numbers of a filter: what `ParticleFilter.state` gives.

    The models and the options of the filter are not in it: it resumes in a filter that was made
    with the same ones.

    Parameters
    ----------
    poses : ndarray of shape (N, 3)
        ``[x, y, heading]`` of the particles.
    weights : Weights
        N of them.
    generator : dict
        The state of the bit generator of the random numbers, as NumPy gives it.
    degenerate_updates : int
        How many observations were ignored.
    """

    poses: FloatArray
    weights: Weights
    generator: dict[str, Any]
    degenerate_updates: int

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the state to a `.npz` file, atomically, without pickle.

        Parameters
        ----------
        path : path
            Its folder must exist.
        """
        described = json.dumps(_as_lists(self.generator), sort_keys=True)
        arrays = {
            "poses": self.poses,
            "log_weights": self.weights.log,
            "weights": self.weights.linear,
            "summary": np.array([self.weights.effective_sample_size, self.weights.log_mean]),
            "degenerate_updates": np.array(self.degenerate_updates, np.int64),
        }
        head = {"format": FORMAT, "version": VERSION, "generator": described}
        head["checksum"] = checksum(described, arrays)
        entries: dict[str, Any] = {name: np.array(value) for name, value in head.items()}
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez(file, **(entries | arrays))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> FilterState:
        """Read a state that `save` wrote.

        Parameters
        ----------
        path : path

        Returns
        -------
        FilterState

        Raises
        ------
        ValueError
            Naming the file, if it is none, of another version, or damaged.
        FileNotFoundError
            If there is no such file.
        """
        stored = read_arrays(path, "particle filter's state")
        if str(stored.pop("format", None)) != FORMAT:
            raise ValueError(f"{path}: not the state of a {FORMAT}")
        version = str(stored.pop("version", None))
        if version != str(VERSION):
            raise ValueError(f"{path}: version {version}, expected {VERSION}")
        described, written = (str(stored.pop(name, "")) for name in ("generator", "checksum"))
        if written != checksum(described, stored) or not stored.keys() >= set(_ARRAYS):
            raise ValueError(f"{path}: checksum does not match, the file is damaged")
        poses, log, linear, (effective, mean), count = (stored[name] for name in _ARRAYS)
        weights = Weights(log, linear, float(effective), float(mean))
        return cls(as_poses(poses), weights, _as_arrays(json.loads(described)), int(count))

    def random_generator(self) -> np.random.Generator:
        """Give a generator that goes on where the filter's was.

        Raises
        ------
        ValueError
            If the state is of no generator that NumPy has.
        """
        name = str(self.generator.get("bit_generator"))
        if name not in _GENERATORS:
            raise ValueError(f"generator: expected one of {', '.join(_GENERATORS)}, got {name}")
        bits = getattr(np.random, name)()
        bits.state = self.generator
        return np.random.Generator(bits)


def _as_lists(state: Any) -> Any:
    """Make a generator's state JSON: some have arrays."""
    if isinstance(state, dict):
        return {name: _as_lists(value) for name, value in state.items()}
    if isinstance(state, np.ndarray):
        return {"dtype": str(state.dtype), "values": state.tolist()}
    return state.item() if isinstance(state, np.generic) else state


def _as_arrays(state: Any) -> Any:
    """Undo `_as_lists`."""
    if isinstance(state, dict) and state.keys() == {"dtype", "values"}:
        return np.array(state["values"], dtype=state["dtype"])
    if isinstance(state, dict):
        return {name: _as_arrays(value) for name, value in state.items()}
    return state
