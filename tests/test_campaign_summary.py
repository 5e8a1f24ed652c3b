"""Outcomes of drives, and what they sum up to: against numbers made by hand."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pflut.campaign import DriveOutcome, read_campaign, summarize_outcomes
from pflut.campaign.figures import confidence_figure, convergence_figure, errors_figure
from pflut.campaign.summary import calibration_curve, groups
from pflut.statistics import wilson_interval

LISTS = ("position_m", "heading_deg", "confidence", "seconds", "num_particles")
GOOD, BAD = 0.1, 3.0


def outcome(good: str, *, kidnapped_at: int | None = None, **changes: Any) -> DriveOutcome:
    """Make a drive: an x is an image that is localized, a dot one that is not."""
    made = DriveOutcome(
        scenario="global" if kidnapped_at is None else "kidnapped",
        filter="pflut",
        seed=0,
        home_seed=0,
        kidnapped_at=kidnapped_at,
        position_m=[GOOD if image == "x" else BAD for image in good],
        heading_deg=[-2.0] * len(good),
        confidence=[1.0 if image == "x" else 0.25 for image in good],
        hypotheses=[2] * len(good),
        held=[1] * len(good),
        seconds=[0.004] * len(good),
        num_particles=[100] * len(good),
        degenerate=1,
    )
    return replace(made, **changes)


# --- outcomes ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("good", "kidnapped_at", "converged", "recovered", "localized"),
    [
        ("xxxx", None, 0, None, "xxxx"),
        (".x.x", None, 3, None, "...x"),
        ("xxx.", None, None, None, "...."),
        ("xxx...xx", 3, 0, 3, "xxx...xx"),
        (".xx.....", 3, 1, None, ".xx....."),
        ("...xx.xx", 3, None, 3, "......xx"),
        ("xx.xxx", 3, None, 0, "...xxx"),
    ],
)
def test_when_a_drive_is_localized(
    good: str, kidnapped_at: int | None, converged: int, recovered: int, localized: str
) -> None:
    drive = outcome(good, kidnapped_at=kidnapped_at)
    assert (drive.converged_at, drive.recovered_at) == (converged, recovered)
    assert "".join("x" if yes else "." for yes in drive.localized) == localized
    assert len(drive) == len(good)


def test_good_is_a_matter_of_both_errors() -> None:
    drive = outcome("xxxx", position_m=[0.49, 0.51, 0.1, 0.1], heading_deg=[9.9, 0.0, -10.1, -9.9])
    assert drive.good.tolist() == [True, False, False, True]


def test_an_outcome_is_read_as_it_was_written(tmp_path: Path) -> None:
    drive = outcome("x..x", kidnapped_at=2)
    drive.save(tmp_path / "seed_0.json")
    assert DriveOutcome.load(tmp_path / "seed_0.json") == drive


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"extra": 1}, "expected a drive's outcome with confidence"),
        ({"confidence": [1.0]}, "lists of one length"),
        ({"position_m": None}, "lists of one length"),
        ({name: [] for name in LISTS}, "lists of one length"),
        ({"heading_deg": ["a", "b", "c"]}, "lists of numbers"),
        ({"seed": "0"}, "whole numbers"),
        ({"kidnapped_at": 1.5}, "whole numbers"),
        ({"degenerate": -1}, "whole numbers"),
        ({"scenario": 3}, "names of a scenario and a filter"),
    ],
)  # fmt: skip
def test_a_damaged_file_is_refused_by_name(
    tmp_path: Path, change: dict[str, Any], words: str
) -> None:
    path = tmp_path / "seed_0.json"
    path.write_text(json.dumps(asdict(outcome("xxx")) | change))
    with pytest.raises(ValueError, match=words) as refused:
        DriveOutcome.load(path)
    assert str(refused.value).startswith(f"{path}: ") and "\n" not in str(refused.value)


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"seed": 0}'])
def test_what_is_no_outcome_is_refused_by_name(tmp_path: Path, text: str) -> None:
    path = tmp_path / "seed_0.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"seed_0\.json: "):
        DriveOutcome.load(path)


def test_campaigns_are_read_in_order(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"expected a folder of pflut simulate"):
        read_campaign(tmp_path)
    (tmp_path / "settings.json").write_text("{}")
    with pytest.raises(ValueError, match="no drive is done yet"):
        read_campaign(tmp_path)
    for scenario, name, seed in (("a", "y", 10), ("a", "y", 9), ("a", "x", 2), ("b", "x", 0)):
        path = tmp_path / scenario / name / f"seed_{seed}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        outcome("x", scenario=scenario, filter=name, seed=seed).save(path)
    found = read_campaign(tmp_path)
    keys = [(o.scenario, o.filter, o.seed) for o in found]
    assert keys == [("a", "x", 2), ("a", "y", 9), ("a", "y", 10), ("b", "x", 0)]
    assert {key: len(some) for key, some in groups(found).items()} == {
        ("a", "x"): 1,
        ("a", "y"): 2,
        ("b", "x"): 1,
    }


# --- summaries ---------------------------------------------------------------------------------


def test_rates_and_their_intervals() -> None:
    drives = ["xxxx", "..xx", "...x", ".....", "xxx."]
    some = [outcome(good, seed=seed) for seed, good in enumerate(drives)]
    summary = summarize_outcomes(some[::-1], within=3)  # in any order
    assert (summary["scenario"], summary["filter"], summary["drives"]) == ("global", "pflut", 5)
    assert summary["images"] == 21 and summary["degenerate"] == 5
    rate = summary["converged"]
    assert (rate["successes"], rate["count"], rate["rate"]) == (2, 5, 0.4)
    assert (rate["low"], rate["high"]) == pytest.approx(wilson_interval(2, 5))
    assert summary["failed_seeds"] == [2, 3, 4]
    assert summary["images_to_convergence"]["count"] == 3
    assert summary["images_to_convergence"]["median"] == 3  # of 1, 3, 4
    assert summary["recovered"] is None and summary["unrecovered_seeds"] == []
    assert summary["ms_per_image"] == pytest.approx(4.0) and summary["particles"] == 100.0


def test_recovery_counts_where_the_robot_was_carried_away() -> None:
    some = [
        outcome("xxx.xx", kidnapped_at=3, seed=0),
        outcome("xxx...", kidnapped_at=3, seed=1),
        outcome("xxx..x", kidnapped_at=3, seed=2),
        outcome("xx", scenario="kidnapped", seed=3),  # stopped before that
    ]
    summary = summarize_outcomes(some, recovered_within=2)
    assert summary["converged"]["successes"] == 4
    assert (summary["recovered"]["successes"], summary["recovered"]["count"]) == (1, 3)
    assert summary["unrecovered_seeds"] == [1, 2]
    assert summary["images_to_recovery"]["median"] == 2.5  # of 2 and 3


def test_errors_are_those_of_localized_images() -> None:
    some = [
        outcome("..xxx", position_m=[9.0, 9.0, 0.1, 0.2, 0.3], seed=0),
        outcome("xxxx.", seed=1),  # never localized
        outcome("xxxxx", position_m=[0.4] * 5, heading_deg=[-4.0] * 5, seed=2),
    ]
    position = (summary := summarize_outcomes(some))["position_m"]
    assert position["count"] == 2 and position["median"] == pytest.approx(0.3)
    assert position["median_low"] == pytest.approx(0.2)
    assert position["median_high"] == pytest.approx(0.4)
    assert position["all_images"] == pytest.approx(0.4)  # of 15
    assert summary["heading_deg"]["median"] == pytest.approx(3.0)  # 2 and 4, without signs


def test_drives_that_are_never_localized_have_no_errors() -> None:
    summary = summarize_outcomes([outcome("....")])
    assert summary["converged"]["rate"] == 0.0
    for name in ("position_m", "heading_deg"):
        assert summary[name]["median"] is None and summary[name]["median_low"] is None
    assert summary["position_m"]["all_images"] == BAD
    json.dumps(summary, allow_nan=False)


def test_sure_and_wrong() -> None:
    some = [
        outcome("x...", confidence=[0.95, 0.95, 0.9, 0.2], seed=0),  # 0.9 is not above 0.9
        *(outcome("xxxx", confidence=[0.99] * 4, seed=seed) for seed in range(1, 5)),
    ]
    summary = summarize_outcomes(some)
    assert summary["sure"] == pytest.approx(18 / 20)
    share = summary["sure_and_wrong"]
    assert share["share"] == pytest.approx(1 / 20)
    # no drive or several with a wrong image may be drawn: 0 of 5 to 3 of 5 of them
    assert share["low"] == 0.0 and share["high"] == pytest.approx(3 / 20)


def test_the_interval_is_one_over_drives() -> None:
    """A hundred wrong images of one drive are no more evidence than a few."""
    short = [outcome("." * 2, confidence=[1.0] * 2), *[outcome("xx")] * 9]
    long = [outcome("." * 200, confidence=[1.0] * 200), *[outcome("x" * 200)] * 9]
    a, b = (summarize_outcomes(some)["sure_and_wrong"] for some in (short, long))
    assert a == pytest.approx(b) and a["high"] - a["low"] >= 0.3


def test_calibration_compares_confidence_and_truth() -> None:
    some = [
        outcome("xx..", confidence=[0.25, 0.999, 0.21, 1.0], seed=0),
        outcome("x...", confidence=[0.23, 0.0, 0.27, 1.0], seed=1),
    ]
    curve = calibration_curve(some)
    assert [part.count for part in curve] == [1, 4, 3]
    assert [part.observed for part in curve] == pytest.approx([0.0, 0.5, 1 / 3])
    assert [part.predicted for part in curve] == pytest.approx([0.0, 0.24, 2.999 / 3])
    assert all(part.low <= part.observed <= part.high for part in curve)
    halves = calibration_curve(some, edges=(0.0, 0.5, 1.0))
    assert [part.count for part in halves] == [5, 3]


# --- figures -----------------------------------------------------------------------------------


def legend(figure: Any) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_convergence_is_drawn_as_shares_of_drives() -> None:
    group = {
        "pflut": [outcome("xxxx"), outcome("..xx"), outcome("....")],
        "odometry": [outcome("....")] * 3,
    }
    figure = convergence_figure(group, scenario="global")
    (panel,) = figure.axes
    assert legend(figure) == ["pflut", "odometry"] and panel.get_xlabel() == "images from the start"
    assert "share of drives" in panel.get_ylabel() and "3 drives" in figure.get_suptitle()
    pflut, odometry = panel.lines
    end = panel.get_xlim()[1]
    assert pflut.get_xydata().tolist() == pytest.approx(
        np.array([[0, 0], [1, 1 / 3], [3, 2 / 3], [end, 2 / 3]])
    )
    assert odometry.get_xydata().tolist() == [[0.0, 0.0], [end, 0.0]]


def test_recovery_has_a_panel_of_its_own() -> None:
    group = {"pflut": [outcome("xx.x", kidnapped_at=2), outcome("xx..", kidnapped_at=2)]}
    before, after = convergence_figure(group, scenario="kidnapped").axes
    assert "carried away" in after.get_xlabel()
    assert before.lines[0].get_ydata().max() == 1.0 and after.lines[0].get_ydata().max() == 0.5


def test_errors_are_drawn_by_scenario_and_filter() -> None:
    group = {
        ("global", "pflut"): [outcome("xxxx"), outcome("....")],
        ("kidnapped", "pflut"): [outcome("xx.x", kidnapped_at=2)],
        ("kidnapped", "odometry"): [outcome("xx..", kidnapped_at=2)],
    }
    figure = errors_figure(group)
    share, position, heading = figure.axes
    assert legend(figure) == ["pflut", "odometry"]  # the second is not in the first scenario
    assert [bar.get_height() for bar in share.patches] == [0.5, 1.0, 0.0]
    assert [text.get_text() for text in heading.get_xticklabels()] == ["global", "kidnapped"]
    assert "[m]" in position.get_ylabel() and "[deg]" in heading.get_ylabel()
    medians = [line.get_ydata()[0] for line in position.lines if line.get_marker() == "o"]
    assert medians == pytest.approx([GOOD] * 3)


def test_titles_and_legends_are_within_the_figure() -> None:
    names = [f"ekf-ransac, results/a_long_name_{k}" for k in range(6)]
    figures = [
        errors_figure({("global", name): [outcome("xx")] for name in names}),
        convergence_figure({name: [outcome("xx")] for name in names}, scenario="global"),
        confidence_figure({name: [outcome("xx" * 5)] for name in names}, title="all scenarios"),
    ]
    for figure in figures:
        figure.draw_without_rendering()
        whole = figure.bbox
        texts = [*figure.legends, *([figure._suptitle] if figure._suptitle else [])]
        for box in (text.get_window_extent() for text in texts):
            assert whole.x0 <= box.x0 and box.x1 <= whole.x1
            assert whole.y0 <= box.y0 and box.y1 <= whole.y1


def test_confidences_are_drawn_beside_the_diagonal() -> None:
    some = [outcome("xxx.xxx.xx", confidence=[0.75] * 10), outcome("x" * 9, confidence=[0.3] * 9)]
    figure = confidence_figure({"pflut": some}, title="global")
    (panel,) = figure.axes
    assert "[%]" in panel.get_xlabel() and "[%]" in panel.get_ylabel()
    assert panel.get_title() == "global" and legend(figure) == ["pflut"]
    diagonal, curve = panel.lines
    assert diagonal.get_xydata().tolist() == [[0, 0], [100, 100]]
    assert curve.get_xydata().tolist() == pytest.approx(np.array([[75.0, 80.0]]))  # not the nine
