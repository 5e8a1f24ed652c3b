"""Every option of a replay: default, range and meaning in one place.

The command line is made from these fields, so nothing heavy is imported here.
"""

from __future__ import annotations

import math
from dataclasses import Field, asdict, dataclass, field, fields
from typing import Any


def _option(default: Any, text: str, group: str, within: str = "", **more: Any) -> Any:
    """Declare an option; ``within`` is its range, as "(0, 1]"."""
    about = {"help": text, "group": group, "within": within, **more}
    return field(default=default, metadata=about)


@dataclass(frozen=True, kw_only=True)
class ReplayOptions:
    """Options of a replay; ``dataclasses.replace`` changes some of them.

    Angles are radians (on the command line degrees, where a name ends in ``-deg``). What each
    option means stands beside it, and ``pflut replay --help`` prints it.

    Raises
    ------
    ValueError
        If an option is out of its range.
    """

    num_particles: int = _option(5000, "particles", "filter", "[1, inf)", flag="particles")
    min_particles: int | None = _option(
        None,
        "take as many particles as the posterior needs (KLD sampling), so many at least and "
        "--particles at most (default: always --particles)",
        "filter",
        "[1, inf)",
        type=int,
    )
    kld_error: float = _option(
        0.05,
        "of KLD sampling: how far the particles may be from the posterior",
        "filter",
        "(0, inf)",
    )
    seed: int = _option(
        0, "of everything random: the same seed gives the same poses", "filter", "[0, inf)"
    )
    start: str | tuple[float, float, float] = _option(
        "lost",
        "lost: anywhere in the map; truth: at the first image's true pose; or a pose as "
        "X,Y,HEADING_DEG (--start=-1,2,90 where X is negative)",
        "filter",
    )
    start_margin: float = _option(
        1.0, "metres around the references where a lost robot may be", "filter", "[0, inf)"
    )
    start_position_std: float = _option(
        0.2, "metres on each axis, how well a given start is known", "filter", "[0, inf)"
    )
    start_heading_std: float = _option(
        math.radians(5.0), "how well its heading is known", "filter", "[0, inf)", angle=True
    )
    resampling: str = _option(
        "systematic",
        "how particles are drawn",
        "filter",
        choices=("systematic", "stratified", "multinomial", "residual", "ssp"),
    )
    ess_threshold: float = _option(
        0.5, "resample below this share of effective particles", "filter", "[0, 1]"
    )
    resample_interval: int = _option(
        1, "and not before so many images since the last time", "filter", "[1, inf)"
    )
    resample_distance: float = _option(
        0.0, "nor before so many metres since then; 0 is off", "filter", "[0, inf)"
    )
    resample_angle: float = _option(
        0.0, "or so large a turn; 0 is off", "filter", "[0, inf)", angle=True
    )
    min_effective_share: float = _option(
        0.1, "an image is flattened until so many effective particles are left", "filter", "[0, 1)"
    )

    hypothesis_temperature: float = _option(
        0.05,
        "factor on what an image says of places against each other, where the robot may be in "
        "several of them",
        "filter",
        "(0, 1]",
    )

    recovery: str = _option(
        "references",
        "where to look for a robot that was carried away: where the references say that look like "
        "the image, anywhere (uniform), or nowhere (none)",
        "recovery",
        choices=("references", "uniform", "none"),
    )
    kidnap_probability: float = _option(
        0.001, "that the robot was carried away between two images", "recovery", "(0, 1)"
    )
    proposal_share: float = _option(
        0.1, "poses proposed an image, as a share of the particles", "recovery", "(0, 1]"
    )
    recovery_alpha_slow: float = _option(
        0.0, "decay of the average likelihood, as AMCL's; 0 is off", "recovery", "[0, 1]"
    )
    recovery_alpha_fast: float = _option(
        0.0, "of the short-term average, the larger one", "recovery", "[0, 1]"
    )

    motion: str = _option(
        "differential",
        "the robot: differential cannot drive sideways",
        "motion",
        choices=("differential", "omnidirectional"),
    )
    rotation_noise_from_rotation: float = _option(
        0.02, "alpha1, a variance per squared radian", "motion", "[0, inf)"
    )
    rotation_noise_from_translation: float = _option(
        0.005, "alpha2, rad^2 / m^2", "motion", "[0, inf)"
    )
    translation_noise_from_translation: float = _option(
        0.02, "alpha3, a variance per squared metre", "motion", "[0, inf)"
    )
    translation_noise_from_rotation: float = _option(
        0.002, "alpha4, m^2 / rad^2", "motion", "[0, inf)"
    )
    strafe_noise_from_translation: float = _option(
        0.02, "alpha5, sideways, omnidirectional only", "motion", "[0, inf)"
    )
    position_noise: float = _option(
        0.0, "metres a step, standard deviation on each axis", "motion", "[0, inf)"
    )
    heading_noise: float = _option(
        0.0, "standard deviation a step", "motion", "[0, inf)", angle=True
    )

    detector: str = _option("sift", "of features", "features", choices=("sift", "orb"))
    contrast_threshold: float = _option(
        0.02, "SIFT's: lower finds more and weaker features", "features", "[0, 1)"
    )
    max_features: int | None = _option(
        None, "keep so many strongest of an image (default: all)", "features", "[1, inf)", type=int
    )
    ratio: float = _option(0.8, "of the ratio test of matches", "features", "(0, 1]")
    mutual: bool = _option(True, "matches must be each other's nearest", "features")

    temperature: float = _option(
        0.3,
        "factor on the log-likelihood: the share of the matches that are independent evidence",
        "sensor model",
        "(0, 1]",
    )
    link_probability: float = _option(
        0.5,
        "how probable it is beforehand that a near reference shows the same scene",
        "sensor model",
        "(0, 1)",
    )
    max_references: int = _option(
        10, "references with the most matches that count", "sensor model", "[1, inf)"
    )
    max_candidates: int = _option(
        32, "references that are matched with an image", "sensor model", "[1, inf)"
    )
    max_range: float | None = _option(
        None,
        "metres; a reference says nothing beyond (default: six times the references' spacing)",
        "sensor model",
        "(0, inf)",
        type=float,
    )
    near_range: float = _option(
        0.3, "metres; nearer to a reference only its rotation counts", "sensor model", "[0, inf)"
    )
    min_matches: int = _option(
        4, "references with fewer matches say nothing", "sensor model", "[1, inf)"
    )
    table: str = _option(
        "default",
        "likelihood table: default; home, sharper and for rooms; perspective, for such cameras as "
        "sharp as a pixel; dense, the paper's; or a file of pflut lut build",
        "sensor model",
        metavar="NAME|FILE",
    )
    bins: int | None = _option(
        None,
        "cells an axis of the table's grids (default: a file's own; else 192, or 256 for cameras "
        "below 0.002 rad a pixel)",
        "sensor model",
        "[4, 512]",
        type=int,
    )

    search_spacing: float = _option(
        0.1, "metres between poses tried (leave one out)", "global search", "(0, inf)"
    )
    search_headings: int = _option(120, "headings tried at each place", "global search", "[1, inf)")
    search_noise: float = _option(
        0.01, "radians, of bearings, for the polish", "global search", "(0, inf)"
    )

    odometry_noise: float = _option(
        0.05, "standard deviation as a share of each motion", "simulated odometry", "[0, inf)"
    )
    odometry_scale: float = _option(
        1.02, "measured metres per true metre", "simulated odometry", "(0, inf)"
    )
    odometry_drift: float = _option(
        math.radians(0.3), "of the heading per metre", "simulated odometry", angle=True
    )

    def __post_init__(self) -> None:
        for item in fields(self):
            _check(item, getattr(self, item.name))
        if self.recovery_alpha_slow > self.recovery_alpha_fast:
            raise ValueError(
                "recovery_alpha_slow: expected at most recovery_alpha_fast, got "
                f"{self.recovery_alpha_slow}"
            )
        if isinstance(self.start, str):
            if self.start not in ("lost", "truth"):
                raise ValueError(f"start: expected 'lost', 'truth' or a pose, got {self.start!r}")
        elif len(self.start) != 3 or not all(map(math.isfinite, self.start)):
            raise ValueError(f"start: expected x, y and heading, got {self.start!r}")

    def as_dict(self) -> dict[str, Any]:
        """Return the options for a JSON file."""
        return asdict(self)


def _check(item: Field[Any], value: Any) -> None:
    """Refuse a value that is out of its option's range, or none of its choices."""
    choices = item.metadata.get("choices")
    if choices is not None and value not in choices:
        raise ValueError(f"{item.name}: expected one of {', '.join(choices)}, got {value!r}")
    within = item.metadata["within"]
    if not within or value is None:
        return
    low, high = (float(end) for end in within[1:-1].split(","))
    above = value > low or (within[0] == "[" and value == low)
    below = value < high or (within[-1] == "]" and value == high)
    if not (above and below):  # a NaN is neither
        raise ValueError(f"{item.name}: expected a number in {within}, got {value!r}")
