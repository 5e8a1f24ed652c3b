"""The table's file: `.npz` without pickle, versioned, with a checksum."""

from __future__ import annotations

import hashlib
import json
import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pflut._files import read_arrays, replacing

FORMAT = "pflut likelihood table"
VERSION = 1


def _checksum(log_ratio: NDArray[np.float32], learned_from: str) -> str:
    digest = hashlib.sha256(np.ascontiguousarray(log_ratio).tobytes())
    digest.update(learned_from.encode())
    return digest.hexdigest()


def write_table(
    path: str | os.PathLike[str], log_ratio: NDArray[np.float32], learned_from: dict[str, Any]
) -> None:
    """Write a table; the file appears when it is whole.

    Parameters
    ----------
    path : path
    log_ratio : ndarray of shape (R, B, B), float32
    learned_from : dict
        How it was learned, JSON-serialisable.
    """
    described = json.dumps(learned_from, sort_keys=True)
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            format=np.array(FORMAT),
            version=np.array(VERSION),
            log_ratio=log_ratio,
            learned_from=np.array(described),
            checksum=np.array(_checksum(log_ratio, described)),
        )


def read_table(path: str | os.PathLike[str]) -> tuple[NDArray[np.float32], dict[str, Any]]:
    """Read a table and check everything about it.

    Parameters
    ----------
    path : path

    Returns
    -------
    log_ratio : ndarray of shape (R, B, B), float32
    learned_from : dict

    Raises
    ------
    ValueError
        If the file is no table, is truncated, of another version, or holds non-finite numbers.
    FileNotFoundError
        If there is no such file.
    """
    stored = read_arrays(path, "likelihood table")
    if str(stored.get("format")) != FORMAT:
        raise ValueError(f"{path}: not a {FORMAT}")
    version = str(stored.get("version"))
    if version != str(VERSION):
        raise ValueError(
            f"{path}: table version {version}, expected {VERSION}; "
            "learn it again with 'pflut lut build' or upgrade pflut"
        )
    missing = {"log_ratio", "learned_from", "checksum"} - stored.keys()
    if missing:
        raise ValueError(f"{path}: damaged {FORMAT}, without {', '.join(sorted(missing))}")
    log_ratio, described = stored["log_ratio"], str(stored["learned_from"])
    shape = log_ratio.shape
    if log_ratio.dtype != np.float32 or len(shape) != 3 or not shape[0] or shape[1] != shape[2]:
        raise ValueError(
            f"{path}: expected log_ratio as (R, B, B) float32, got {shape} {log_ratio.dtype}"
        )
    if not np.isfinite(log_ratio).all():
        raise ValueError(f"{path}: the table holds numbers that are not finite")
    if str(stored["checksum"]) != _checksum(log_ratio, described):
        raise ValueError(f"{path}: checksum does not match, the file is damaged")
    try:
        learned_from = json.loads(described)
    except ValueError:
        learned_from = None
    if not isinstance(learned_from, dict):
        raise ValueError(f"{path}: expected learned_from as a JSON object, got {described!r:.40}")
    return log_ratio, learned_from
