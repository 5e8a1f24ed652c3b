"""The options of a replay: ranges, and the command line that is made from them."""

from __future__ import annotations

import argparse
import dataclasses
import math

import pytest

from pflut.cli.arguments import add_replay_options, replay_options
from pflut.replay.options import ReplayOptions


def parse(*arguments: str) -> ReplayOptions:
    parser = argparse.ArgumentParser()
    add_replay_options(parser)
    parser.set_defaults(parser=parser)
    return replay_options(parser.parse_args(arguments))


def test_no_argument_gives_the_defaults() -> None:
    assert parse() == ReplayOptions()


def test_every_field_has_an_argument_that_changes_it() -> None:
    """The command line cannot lag behind the options."""
    other = {"start": "truth", "motion": "omnidirectional", "detector": "orb"}
    other |= {"resampling": "residual", "mutual": "--no-mutual", "recovery": "uniform"}
    flags = {"num_particles": "--particles"}
    for item in dataclasses.fields(ReplayOptions):
        flag = flags.get(item.name, "--" + item.name.replace("_", "-"))
        flag += "-deg" if item.metadata.get("angle") else ""
        value = other.get(item.name, "0.25" if isinstance(item.default, float) else "7")
        words = [value] if value.startswith("--") else [flag, value]
        # the slow average may not be the faster one
        before = ("--recovery-alpha-fast", "0.5") if item.name == "recovery_alpha_slow" else ()
        options = (parse(*before, *words), parse(*before))
        changed = dataclasses.asdict(options[0]).items() ^ dataclasses.asdict(options[1]).items()
        assert {name for name, _ in changed} == {item.name}, flag


def test_every_option_is_documented() -> None:
    parser = argparse.ArgumentParser()
    add_replay_options(parser)
    text = " ".join(parser.format_help().split())
    for item in dataclasses.fields(ReplayOptions):
        assert item.metadata["help"] in text
    assert text.count("(default: ") >= len(dataclasses.fields(ReplayOptions))


def test_angles_are_degrees_on_the_command_line() -> None:
    assert parse("--start-heading-std-deg", "90").start_heading_std == math.pi / 2
    assert parse("--start=-1,2,180").start == (-1.0, 2.0, math.pi)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("num_particles", 0),
        ("temperature", 0.0),
        ("temperature", 1.5),
        ("temperature", math.nan),
        ("ratio", 1.01),
        ("link_probability", 1.0),
        ("bins", 3),
        ("max_range", 0.0),
        ("heading_noise", -1.0),
        ("start_position_std", math.inf),
        ("detector", "surf"),
        ("min_particles", 0),
        ("kld_error", 0.0),
        ("resample_interval", 0),
        ("resample_distance", -0.1),
        ("recovery", "everywhere"),
        ("kidnap_probability", 0.0),
        ("kidnap_probability", 1.0),
        ("proposal_share", 1.01),
        ("recovery_alpha_slow", 0.1),  # more than the fast one
        ("start", "here"),
        ("start", (1.0, math.nan, 0.0)),
        ("start", (1.0, 2.0)),
    ],
)
def test_values_out_of_range_are_refused_by_name(name: str, value: object) -> None:
    with pytest.raises(ValueError, match=f"^{name}: expected"):
        ReplayOptions(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("edge", [{"temperature": 1.0}, {"ess_threshold": 0.0}, {"bins": 512}])
def test_ends_of_ranges_that_belong_to_them(edge: dict[str, float]) -> None:
    for name, value in edge.items():
        assert getattr(ReplayOptions(**edge), name) == value  # type: ignore[arg-type]


def test_out_of_range_on_the_command_line_is_wrong_usage(capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit) as caught:
        parse("--temperature", "3")
    assert caught.value.code == 2
    assert "argument --temperature: expected a number in (0, 1], got 3.0" in capsys.readouterr().err
