"""Camera files: TOML, one table with the model's parameters and one with the mount."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields
from importlib import import_module
from pathlib import Path
from typing import Any

from pflut._files import write_text
from pflut.camera.base import Camera
from pflut.camera.fields import checked_value, is_angle
from pflut.camera.mount import Mount

MODELS: dict[str, tuple[str, str]] = {
    "equirectangular": ("pflut.camera.equirectangular", "EquirectangularPanorama"),
    "cylindrical": ("pflut.camera.cylindrical", "CylindricalPanorama"),
    "perspective": ("pflut.camera.perspective", "Perspective"),
    "fisheye": ("pflut.camera.fisheye", "Fisheye"),
    "hyperbolic": ("pflut.camera.hyperbolic", "HyperbolicMirror"),
    "ocamcalib": ("pflut.camera.ocamcalib", "OcamCalib"),
}


def load_camera(path: str | Path) -> Camera:
    """Read a camera file.

    The file names the ``model`` and holds that model's parameters under the names that its
    Python class has; angles end in ``_deg`` and are degrees. A table ``[mount]`` may hold
    ``yaw_deg``, ``pitch_deg``, ``roll_deg`` and ``height`` (metres)::

        model = "perspective"
        width = 1226
        height = 370
        fx = 707.0912
        fy = 707.0912
        cx = 601.8873
        cy = 183.1104

        [mount]
        height = 1.65

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Camera

    Raises
    ------
    ValueError
        In one line with the file and the key: not TOML, an unknown model, an unknown or
        missing key, a value of the wrong type or not finite.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    try:
        table = tomllib.loads(path.read_bytes().decode("utf-8"))
    except ValueError as error:
        raise ValueError(f"{path}: not a TOML file: {error}") from None
    name = table.pop("model", None)
    if not isinstance(name, str) or name not in MODELS:
        known = ", ".join(MODELS)
        got = "no such key" if name is None else repr(name)
        raise ValueError(f"{path}: model: expected one of {known}, got {got}")
    module, attribute = MODELS[name]
    cls = getattr(import_module(module), attribute)
    mount = table.pop("mount", {})
    if not isinstance(mount, dict):
        raise ValueError(f"{path}: mount: expected a table, got {mount!r}")
    try:
        parameters = _parameters(cls, table, "")
        return cls(**parameters, mount=Mount(**_parameters(Mount, mount, "mount.")))  # type: ignore[no-any-return]
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def save_camera(camera: Camera, path: str | Path) -> None:
    """Write a camera file that `load_camera` reads back.

    Numbers are written with all their digits; angles go through degrees, so they come back
    to within one unit in the last place.

    Parameters
    ----------
    camera : Camera
    path : str or Path
        Its folder must exist.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    lines = [f'model = "{camera.model}"', *_lines(camera), "", "[mount]", *_lines(camera.mount)]
    write_text(path, "\n".join(lines) + "\n")


def _key(declared: Field[Any]) -> str:
    return declared.name + ("_deg" if is_angle(declared) else "")


def _parameters(cls: type[Any], table: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    """Turn a TOML table into keyword arguments."""
    declared = {_key(item): item for item in fields(cls) if item.name != "mount"}
    for key in table:
        if key not in declared:
            names = [prefix + name for name in declared]
            allowed = ", ".join(names if prefix else ["model", *names, "[mount]"])
            raise ValueError(f"unknown key {prefix + key!r} (allowed: {allowed})")
    parameters = {}
    for key, item in declared.items():
        if key not in table:
            if item.default is MISSING and item.default_factory is MISSING:
                raise ValueError(f"missing key {prefix + key!r}")
            continue
        try:
            value = checked_value(item, table[key])
        except ValueError as error:
            raise ValueError(f"{prefix}{key}: {error}") from None
        parameters[item.name] = math.radians(value) if is_angle(item) else value
    return parameters


def _lines(instance: Any) -> list[str]:
    """Write the scalar fields of a dataclass as TOML."""
    lines = []
    for item in fields(instance):
        if item.name == "mount":
            continue
        value = getattr(instance, item.name)
        if is_angle(item):
            value = math.degrees(value)
        # JSON's numbers, booleans, texts and lists of numbers are TOML's
        lines.append(f"{_key(item)} = {json.dumps(value)}")
    return lines
