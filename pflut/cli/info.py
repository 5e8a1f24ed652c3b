"""``pflut info``: versions, folders, and what is there."""

from __future__ import annotations

import argparse
from pathlib import Path

from pflut.cli.arguments import Subparsers, add_verb


def add_parser(verbs: Subparsers) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs,
        "info",
        "print versions, the machine, the cache folder and the datasets that are there",
        usage="",
        details="For reports of problems, and to see where disk space went: the cache folder may "
        "be\ndeleted at any time. PFLUT_CACHE names another one, PFLUT_DATA a folder of datasets.",
    )
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> None:
    """Print it."""
    import cv2
    import numba

    import pflut
    from pflut._cache import cache_dir
    from pflut.datasets.registry import SIMULATED_HOME, data_root
    from pflut.environment import machine, versions

    for name, value in (versions() | {"opencv": cv2.__version__} | machine()).items():
        _print(name, value)
    cache = cache_dir()
    _print("cache", f"{cache} ({_megabytes(cache):.0f} MB)")
    for name, text in (("features", "of images"), ("simulated-home", "rendered")):
        folder = cache / name
        if folder.is_dir():
            entries = sum(1 for _ in folder.iterdir())
            _print(f"  {name}", f"{entries} {text}, {_megabytes(folder):.0f} MB")
    tables = sorted(cache.glob("dense-*.npz"))
    for path in tables:
        _print("  table", f"{path.name}, {path.stat().st_size / 1e6:.0f} MB")
    if not tables:
        _print("  table", "none learned; the default one comes with pflut")
    compiled = not numba.config.DISABLE_JIT
    _print("numba", "compiles" if compiled else "switched off by NUMBA_DISABLE_JIT: very slow")
    _print(
        "  cache", numba.config.CACHE_DIR or f"{Path(pflut._jit.__file__).parent}/**/__pycache__"
    )
    _print("threads", f"OpenCV {cv2.getNumThreads()}, Numba {numba.config.NUMBA_NUM_THREADS}")
    _print("datasets", SIMULATED_HOME)
    root = data_root()
    if root is not None:
        for folder in sorted(root.iterdir()):
            if any((folder / n).is_file() for n in ("camera.toml", "zind_data.json", "calib.txt")):
                _print("", str(folder))


def _print(name: str, value: object) -> None:
    print(f"{name:<18}{value}")


def _megabytes(folder: Path) -> float:
    """Give what the files of a folder take; one that is just being replaced counts nothing."""
    total = 0
    for path in folder.rglob("*"):
        try:
            total += path.stat().st_size if path.is_file() else 0
        except OSError:
            continue
    return total / 1e6
