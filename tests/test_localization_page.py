"""The blocks of docs/localization.md, run one after the other."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

PAGE = Path(__file__).parents[1] / "docs" / "localization.md"
BLOCKS = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.M | re.S)


def test_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    kidnapped, late, saved = BLOCKS
    exec(kidnapped, names)
    drive, pf, step = names["drive"], names["pf"], names["step"]
    offset = step.estimate.pose - step.ground_truth
    assert np.hypot(*offset[:2]) < 0.1
    assert step.estimate.confidence > 0.9

    # goes on at the page's own times: stamps of the drive are taken back, and it stands still
    last = step.index
    pf.initialize_gaussian(step.ground_truth, np.diag([0.01, 0.01, 0.001]))
    pf.update(drive.observation(last), stamp=12.2)
    names |= {"odometry": [0.0, 0.0, 0.0], "image": drive.observation(last)}
    exec(late, names)
    estimate = names["estimate"]
    assert estimate.delay == pytest.approx(0.13)
    assert not estimate.dropped
    assert np.hypot(*(estimate.pose - step.ground_truth)[:2]) < 0.1

    before = pf.poses.copy()
    exec(saved, names)
    np.testing.assert_array_equal(names["pf"].poses, before)
    assert (tmp_path / "robot.npz").is_file()
