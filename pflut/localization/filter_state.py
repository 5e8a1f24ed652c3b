"""All that a particle filter has become, to be saved and resumed to the last bit."""

from __future__ import annotations

import json
import os
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pflut._files import checksum, read_arrays, replacing
from pflut.geometry import as_poses
from pflut.localization.history import History, Moment
from pflut.localization.particles import Particles
from pflut.localization.recovery import LikelihoodAverages
from pflut.localization.resampling_policy import SinceResampling
from pflut.localization.weights import Weights

FORMAT = "pflut particle filter"
VERSION = 2
_ARRAYS = (
    "poses",
    "log_weights",
    "weights",
    "summary",
    "since",
    "averages",
    "stamp",
    "counts",
    "history_stamps",
    "history_sizes",
    "history_poses",
    "history_ancestors",
)
_GENERATORS = ("PCG64", "PCG64DXSM", "MT19937", "Philox", "SFC64")


@dataclass(frozen=True, eq=False)
class FilterState:
    """Particles, counts and random numbers of a filter: what `ParticleFilter.state` gives.

    The models and the options of the filter are not in it: it resumes in a filter that was made
    with the same ones.

    Parameters
    ----------
    particles : Particles
        With their history.
    averages : LikelihoodAverages
    generator : dict
        The state of the bit generator of the random numbers, as NumPy gives it.
    degenerate_updates, dropped_updates : int
        How many observations were ignored, or came too late.
    """

    particles: Particles
    averages: LikelihoodAverages
    generator: dict[str, Any]
    degenerate_updates: int
    dropped_updates: int

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the state to a `.npz` file, atomically, without pickle.

        Parameters
        ----------
        path : path
            Its folder must exist.
        """
        particles, weights = self.particles, self.particles.weights
        stamp = np.nan if particles.stamp is None else particles.stamp
        described = json.dumps(_as_lists(self.generator), sort_keys=True)
        arrays = {
            "poses": particles.poses,
            "log_weights": weights.log,
            "weights": weights.linear,
            "summary": np.array([weights.effective_sample_size, weights.log_mean]),
            "since": np.array(astuple(particles.since), np.float64),
            "averages": np.array(self.averages, np.float64),
            "stamp": np.array([stamp, particles.clocked], np.float64),
            "counts": np.array([self.degenerate_updates, self.dropped_updates], np.int64),
            **_history_arrays(particles),
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
        effective, mean = stored["summary"].tolist()
        share, updates, *way = stored["since"].tolist()
        stamp, clocked = stored["stamp"].tolist()
        moments = _moments(stored)
        particles = Particles(
            as_poses(stored["poses"]),
            Weights(
                len(stored["weights"]), effective, mean, (stored["log_weights"], stored["weights"])
            ),
            History(max(len(moments) - 1, 0), moments),
            SinceResampling(share, int(updates), *way),
            None if np.isnan(stamp) else stamp,
            bool(clocked),
        )
        averages = LikelihoodAverages(*stored["averages"].tolist())
        generator = _as_arrays(json.loads(described))
        return cls(particles, averages, generator, *stored["counts"].tolist())

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


def _history_arrays(particles: Particles) -> dict[str, NDArray[Any]]:
    """Make one array of the poses of all moments, and one of the ancestors."""
    moments = particles.history.moments
    own = np.arange(len(particles), dtype=np.int32)
    ancestors = [own if m.ancestors is None else m.ancestors for m in moments]
    return {
        "history_stamps": np.array([moment.stamp for moment in moments], np.float64),
        "history_sizes": np.array([len(moment.poses) for moment in moments], np.int64),
        "history_poses": np.concatenate([np.empty((0, 3)), *(m.poses for m in moments)]),
        "history_ancestors": np.array(ancestors, np.int32).reshape(len(moments), len(particles)),
    }


def _moments(stored: dict[str, NDArray[Any]]) -> list[Moment]:
    """Undo `_history_arrays`."""
    ends = np.cumsum(stored["history_sizes"])[:-1]
    stamps, ancestors = stored["history_stamps"].tolist(), stored["history_ancestors"]
    poses = np.split(stored["history_poses"], ends) if stamps else []
    return [Moment(*each) for each in zip(stamps, poses, ancestors, strict=True)]


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
