"""The blocks of docs/mapping.md, run one after the other."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

from pflut.mapping.g2o import read_g2o
from pflut.mapping.map_errors import MapErrors

PAGE = Path(__file__).parents[1] / "docs" / "mapping.md"
BLOCKS = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.M | re.S)


def test_the_page_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("scipy")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    drive, with_gtsam, *_ = BLOCKS
    exec(drive, names)
    before, after = map(float, capsys.readouterr().out.splitlines()[:2])
    assert before > 0.3 and after < 0.25 * before
    found = names["found"]
    np.testing.assert_array_equal(read_g2o("map.g2o").poses, found.poses)
    if importlib.util.find_spec("gtsam"):
        exec(with_gtsam, names)
        error = MapErrors.of(names["poses"], names["truth"]).position
        assert error == pytest.approx(after, abs=0.02)
