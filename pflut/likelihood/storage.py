"""The table's file: `.npz` without pickle, versioned, with a checksum."""

from __future__ import annotations

import hashlib
import json
import os
import zipfile
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pflut._files import replacing

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
    try:
        with np.load(path, allow_pickle=False) as file:
            if "format" not in file or str(file["format"]) != FORMAT:
                raise ValueError(f"{path}: not a likelihood table of pflut")
            version = int(file["version"])
            if version != VERSION:
                raise ValueError(
                    f"{path}: table version {version}, expected {VERSION}; "
                    "learn it again with 'pflut lut build' or upgrade pflut"
                )
            log_ratio = file["log_ratio"]
            described = str(file["learned_from"])
            checksum = str(file["checksum"])
    except (zipfile.BadZipFile, zlib.error, EOFError, KeyError, TypeError) as error:
        raise ValueError(f"{path}: truncated or damaged likelihood table ({error})") from error
    except ValueError as error:
        if str(path) in str(error):
            raise
        raise ValueError(f"{path}: not a likelihood table of pflut ({error})") from error
    if log_ratio.dtype != np.float32 or log_ratio.ndim != 3:
        raise ValueError(
            f"{path}: expected log_ratio as (R, B, B) float32, "
            f"got {log_ratio.shape} {log_ratio.dtype}"
        )
    if not np.isfinite(log_ratio).all():
        raise ValueError(f"{path}: the table holds numbers that are not finite")
    if checksum != _checksum(log_ratio, described):
        raise ValueError(f"{path}: checksum does not match, the file is damaged")
    return log_ratio, json.loads(described)
