"""What a result depends on beside its inputs: versions and the machine."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

import pflut

#: Distributions by the name that a report gives them; the first that is installed counts.
_DISTRIBUTIONS = {
    "numpy": ("numpy",),
    "numba": ("numba",),
    "opencv": ("opencv-python-headless", "opencv-python", "opencv-contrib-python-headless"),
    "matplotlib": ("matplotlib",),
}


def versions() -> dict[str, str]:
    """Return the versions of pflut, Python and of the packages that numbers come from."""
    found = {"pflut": pflut.__version__, "python": platform.python_version()}
    for name, distributions in _DISTRIBUTIONS.items():
        found[name] = _version(distributions)
    return found


def machine() -> dict[str, str | int]:
    """Return the platform, the processor and how many cores this process may use."""
    from pflut.likelihood.sampling import available_cores

    return {
        "platform": platform.platform(),
        "processor": platform.processor() or platform.machine(),
        "cores": available_cores(),
    }


def _version(distributions: tuple[str, ...]) -> str:
    for distribution in distributions:
        try:
            return version(distribution)
        except PackageNotFoundError:
            continue
    return "unknown"
