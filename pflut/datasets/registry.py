"""Find the loader of a dataset by its name or by what its folder holds."""

from __future__ import annotations

import os
from pathlib import Path

import pflut
from pflut.datasets.base import Dataset, References

SIMULATED_HOME = "simulated-home"


def data_root() -> Path | None:
    """Return the folder that holds public datasets, if there is one.

    Returns
    -------
    Path or None
        The folder that the environment variable ``PFLUT_DATA`` names; without it a folder
        ``shared/data`` beside a checkout of the project.
    """
    named = os.environ.get("PFLUT_DATA")
    checkout = Path(pflut.__file__).resolve().parents[1]
    folder = Path(named) if named else checkout.parent / "shared" / "data"
    return folder if folder.is_dir() else None


def load_dataset(
    path_or_name: str | os.PathLike[str] = SIMULATED_HOME,
    *,
    references: References | None = None,
) -> Dataset:
    """Load a dataset.

    Parameters
    ----------
    path_or_name : path or str
        A folder: one of the folder format (it holds ``camera.toml``), a home of ZInD
        (``zind_data.json``) or a sequence of KITTI odometry (``calib.txt``). Or
        ``"simulated-home"``, or the name of a folder in `data_root`.
    references : str, path or sequence of int, optional
        Which images are references, see `Dataset.with_references`; the format decides if not
        given.

    Returns
    -------
    Dataset

    Raises
    ------
    FileNotFoundError
        If there is no such folder.
    ValueError
        If the folder is of no known format, or something is wrong in it.
    """
    folder = Path(path_or_name)
    if os.fspath(path_or_name) == SIMULATED_HOME and not folder.is_dir():
        from pflut.datasets.simulated_home import load_simulated_home

        home: Dataset = load_simulated_home()
        return home if references is None else home.with_references(references)
    root = data_root()
    if not folder.is_dir() and not folder.is_absolute() and root is not None:
        folder = root / folder
    if not folder.is_dir():
        raise FileNotFoundError(
            f"{path_or_name}: no such dataset, expected a folder or {SIMULATED_HOME!r}"
        )
    if (folder / "camera.toml").is_file():
        from pflut.datasets.folder import load_folder

        return load_folder(folder, references=references)
    if (folder / "zind_data.json").is_file():
        from pflut.datasets.zind import load_zind

        return load_zind(folder, references=references)
    if (folder / "calib.txt").is_file():
        from pflut.datasets.kitti import load_kitti_odometry

        return load_kitti_odometry(folder, references=references)
    raise ValueError(
        f"{folder}: not recognized, expected camera.toml (folder format), zind_data.json (ZInD) "
        "or calib.txt (KITTI odometry)"
    )
