"""People who walk about during a drive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pflut.geometry import FloatArray
from pflut.simulation.drive import plan_test_drive
from pflut.simulation.home import Home
from pflut.simulation.lighting import LightMap
from pflut.simulation.scene import SceneBuilder
from pflut.simulation.stock import Stock
from pflut.trajectory import Trajectory

POLITENESS = 0.7  # metres: nobody comes closer to the robot
STRIDE = 0.7  # metres
PACE = 1.6  # how much faster than the robot they walk


@dataclass(frozen=True, eq=False)
class Walkers:
    """People and their ways.

    Attributes
    ----------
    stock : Stock
        They wear its fabrics.
    paths : tuple of Trajectory
        One a person; walked again from its start when it ends.
    looks : tuple of int
        Seeds of what each looks like.
    """

    stock: Stock
    paths: tuple[Trajectory, ...]
    looks: tuple[int, ...]

    @classmethod
    def plan(cls, home: Home, count: int, *, rng: np.random.Generator) -> Walkers:
        """Send a number of people on random ways through a home."""
        paths = []
        for _ in range(count):
            path = plan_test_drive(home, rng=rng).path
            paths.append(Trajectory(path.stamps / PACE, path.poses))
        looks = tuple(int(v) for v in rng.integers(2**31, size=count))
        return cls(home.stock, tuple(paths), looks)

    def poses(self, stamp: float) -> FloatArray:
        """Give where everybody is at a time, shape (count, 3)."""
        rows = [path.interpolate([stamp % path.stamps[-1]])[0] for path in self.paths]
        return np.array(rows).reshape(-1, 3)

    def light_map(self, light_map: LightMap, stamp: float, robot: FloatArray) -> LightMap:
        """Add everybody to a home's surfaces, but those who would stand on the robot.

        Parameters
        ----------
        light_map : LightMap
            Of the home without people.
        stamp : float
            Seconds.
        robot : ndarray of shape (3,)
            Its pose.

        Returns
        -------
        LightMap
        """
        builder = SceneBuilder()
        for look, (x, y, heading) in zip(self.looks, self.poses(stamp), strict=True):
            if np.hypot(x - robot[0], y - robot[1]) > POLITENESS:
                with builder.placed(float(x), float(y), float(heading)):
                    _person(builder, self.stock, look, stamp)
        return light_map.with_surfaces(builder.rows()) if builder.surfaces else light_map


def _person(b: SceneBuilder, stock: Stock, look: int, stamp: float) -> None:
    """Draw somebody walking along x."""
    rng = np.random.default_rng(look)
    shirt = stock.fabrics[int(rng.integers(len(stock.fabrics)))]
    trousers = stock.colors[int(rng.integers(len(stock.colors)))]
    head = stock.faces[int(rng.integers(len(stock.faces)))]
    tall = float(rng.uniform(0.92, 1.06))
    swing = 0.5 * STRIDE * float(np.sin(2.0 * np.pi * stamp / 1.1 + rng.uniform(0.0, 6.0)))
    for side, step in ((-0.1, swing), (0.1, -swing)):
        b.cylinder((0.35 * step, side), 0.075, (0.45 * tall, 0.88 * tall), trousers)
        b.cylinder((0.6 * step, side), 0.06, (0.0, 0.48 * tall), trousers)
        arm = -0.3 * step
        b.cylinder((arm, 2.3 * side), 0.045, (0.8 * tall, 1.4 * tall), shirt)
        b.sphere((1.4 * arm, 2.3 * side, 0.77 * tall), 0.05, head)
    b.cylinder((0.0, 0.0), 0.17, (0.85 * tall, 1.34 * tall), shirt)
    b.sphere((0.0, 0.0, 1.36 * tall), 0.19, shirt, flattening=0.5)
    b.cylinder((0.0, 0.0), 0.05, (1.4 * tall, 1.52 * tall), head)
    b.sphere((0.0, 0.0, 1.62 * tall), 0.105, head, flattening=1.25)
