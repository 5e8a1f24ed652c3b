"""Batches of pairs on a cluster of dask: the workers get features and give links."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Protocol, Self  # noqa: F401

import numpy as np
from numpy.typing import NDArray
