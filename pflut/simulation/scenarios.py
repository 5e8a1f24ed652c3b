"""What can be hard about localization: named scenarios of drives through homes of landmarks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from pflut.simulation.landmark_home import Plan


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """What a simulated drive is like.

    Parameters
    ----------
    name : str
    description : str
        One sentence.
    plan : {"home", "corridor"}
        A furnished flat, or a corridor of segments that look the same.
    start : {"truth", "lost"}
        Whether the localization starts from the true pose or anywhere in the home.
    kidnapped : bool
        Whether the robot is carried elsewhere about halfway.
    matches : float
        Mean number of matches with a reference within 5 m.
    true_share : float
        Share of these that are true, in (0, 1).
    noise : float
        Of bearings, radians, isotropic on the sphere.
    reference_spacing : float
        Metres from each reference to the nearest, at least.
    odometry_scale : float
        Measured metres per true metre.
    odometry_drift : float
        Radians that the heading is wrongly measured to turn per metre.
    odometry_noise : float
        Factor on the standard deviations of ``simulate_odometry``.
    people : int
        How many walk about, while mapping too.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    name: str
    description: str
    plan: Plan = "home"
    start: Literal["truth", "lost"] = "lost"
    kidnapped: bool = False
    matches: float = 25.0
    true_share: float = 0.2
    noise: float = 0.01
    reference_spacing: float = 0.6
    odometry_scale: float = 1.01
    odometry_drift: float = 0.005
    odometry_noise: float = 1.0
    people: int = 0

    def __post_init__(self) -> None:
        for name, choices in (("plan", ("home", "corridor")), ("start", ("truth", "lost"))):
            if getattr(self, name) not in choices:
                raise ValueError(f"{name}: expected one of {choices}, got {getattr(self, name)!r}")
        if not 0.0 < self.true_share < 1.0:
            raise ValueError(f"true_share: expected in (0, 1), got {self.true_share}")
        if not 0.0 <= self.noise < np.pi / 2:
            raise ValueError(f"noise: expected radians in [0, pi/2), got {self.noise}")
        for name in ("matches", "reference_spacing", "odometry_scale"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name}: expected a positive number, got {getattr(self, name)}")
        if not np.isfinite(self.odometry_drift):
            raise ValueError(f"odometry_drift: expected a number, got {self.odometry_drift}")
        if not 0.0 <= self.odometry_noise < np.inf:
            raise ValueError(f"odometry_noise: expected at least 0, got {self.odometry_noise}")
        if isinstance(self.people, bool) or self.people != int(self.people) or self.people < 0:
            raise ValueError(f"people: expected a whole number >= 0, got {self.people}")


SCENARIOS = {
    scenario.name: scenario
    for scenario in (
        Scenario(
            name="tracking",
            description="The robot knows where it starts.",
            start="truth",
        ),
        Scenario(
            name="global",
            description="The robot starts lost, anywhere in the home.",
        ),
        Scenario(
            name="kidnapped",
            description="Halfway somebody carries the robot at least 3 m away, which odometry "
            "does not tell.",
            start="truth",
            kidnapped=True,
        ),
        Scenario(
            name="dark",
            description="It is dark: matches are few, and few of them are true.",
            matches=10.0,
            true_share=0.08,
            noise=0.015,
        ),
        Scenario(
            name="crowded",
            description="People walk about, hide what is behind them, and are matched with "
            "themselves where they stood before.",
            people=12,
        ),
        Scenario(
            name="corridor",
            description="The segments of a corridor look the same; only its ends and one poster "
            "tell where the robot is.",
            plan="corridor",
        ),
        Scenario(
            name="sparse",
            description="Reference images are 2.5 m apart.",
            reference_spacing=2.5,
        ),
        Scenario(
            name="odometry",
            description="Odometry measures 15 % too much, drifts, and is three times as noisy.",
            odometry_scale=1.15,
            odometry_drift=0.03,
            odometry_noise=3.0,
        ),
        Scenario(
            name="mismatches",
            description="Nine of ten matches are wrong.",
            true_share=0.1,
        ),
    )
}
"""The named scenarios."""
