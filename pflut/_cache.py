"""The folder where things that were computed once are kept."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path


def cache_dir() -> Path:
    """Return the user's cache folder; it is created when missing.

    ``PFLUT_CACHE`` names it; without it the platform's own place is taken:
    ``$XDG_CACHE_HOME/pflut`` or ``~/.cache/pflut``, ``~/Library/Caches/pflut`` on macOS,
    ``%LOCALAPPDATA%/pflut`` on Windows. Where that cannot be written (a read-only home), a
    folder of the system's temporary directory serves, so that nothing fails for want of a cache.

    Returns
    -------
    Path
        An existing folder.

    Raises
    ------
    OSError
        If ``PFLUT_CACHE`` names a folder that cannot be created or written.
    """
    named = os.environ.get("PFLUT_CACHE")
    if named:
        folder = Path(named).expanduser()
        if not _is_writable(folder):
            raise OSError(f"PFLUT_CACHE: cannot write to {folder}, expected a writable folder")
        return folder
    folder = _platform_folder()
    if _is_writable(folder):
        return folder
    owner = os.getuid() if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
    folder = Path(tempfile.gettempdir()) / f"pflut-{owner}"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    return folder


def _platform_folder() -> Path:
    """Return where this platform keeps the caches of applications."""
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local")) / "pflut"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "pflut"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "pflut"


def _is_writable(folder: Path) -> bool:
    """Create the folder if need be and say whether files can be created in it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK | os.X_OK)
