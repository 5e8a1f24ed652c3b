"""The tables' file: `.npz` without pickle, versioned, with a checksum."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pflut._files import checksum, read_arrays, replacing

FORMAT = "pflut likelihood table"
VERSION = 2
_HEAD = ("format", "version", "kind", "learned_from", "checksum")


def _checksum(kind: str, arrays: Mapping[str, NDArray[Any]], learned_from: str) -> str:
    return checksum(f"{kind}\n{learned_from}\n", arrays)


def write_table(
    path: str | os.PathLike[str],
    kind: str,
    arrays: Mapping[str, NDArray[Any]],
    learned_from: dict[str, Any],
) -> None:
    """Write a table; the file appears when it is whole.

    Parameters
    ----------
    path : path
    kind : str
        "residual" or "dense".
    arrays : mapping of str to ndarray
    learned_from : dict
        How it was learned, JSON-serialisable.
    """
    described = json.dumps(learned_from, sort_keys=True)
    with replacing(path) as temporary, temporary.open("wb") as file:
        entries: dict[str, Any] = {
            "format": np.array(FORMAT),
            "version": np.array(VERSION),
            "kind": np.array(kind),
            "learned_from": np.array(described),
            "checksum": np.array(_checksum(kind, arrays, described)),
        }
        np.savez_compressed(file, **(entries | dict(arrays)))


def read_table(
    path: str | os.PathLike[str],
) -> tuple[str, dict[str, NDArray[Any]], dict[str, Any]]:
    """Read a table's file and check all of it that does not depend on its kind.

    Parameters
    ----------
    path : path

    Returns
    -------
    kind : str
    arrays : dict of str to ndarray
        Of finite numbers.
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
    missing = set(_HEAD) - stored.keys()
    if missing:
        raise ValueError(f"{path}: damaged {FORMAT}, without {', '.join(sorted(missing))}")
    kind, described = str(stored["kind"]), str(stored["learned_from"])
    arrays = {name: value for name, value in stored.items() if name not in _HEAD}
    for name, value in arrays.items():
        if value.dtype.kind not in "fiu":
            raise ValueError(f"{path}: expected numbers as {name}, got {value.dtype}")
        if not np.isfinite(value).all():
            raise ValueError(f"{path}: the table holds numbers that are not finite")
    if str(stored["checksum"]) != _checksum(kind, arrays, described):
        raise ValueError(f"{path}: checksum does not match, the file is damaged")
    try:
        learned_from = json.loads(described)
    except ValueError:
        learned_from = None
    if not isinstance(learned_from, dict):
        raise ValueError(f"{path}: expected learned_from as a JSON object, got {described!r:.40}")
    return kind, arrays, learned_from
