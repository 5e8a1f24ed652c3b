"""``pflut relpose``: the relative pose of two images."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from pflut.cli.arguments import Subparsers, add_verb

if TYPE_CHECKING:
    from pflut.correspondences import Correspondences
    from pflut.datasets.base import Dataset
    from pflut.likelihood.dense import DenseTable
    from pflut.likelihood.table import LikelihoodTable

_DETAILS = """\
A is the reference view L, B the query view R. Printed are heading_l, the direction from A to B in
A's robot frame, heading_r, the direction from B to A in B's, and B's rotation relative to A; all
counter-clockwise, 0 is forward. The distance cannot be seen.

Images of which no pose can be told (too few matches agree) are no error: success is then "no",
the headings are the best guess, and the exit code is 0."""

_EXAMPLES = """\
  pflut relpose a.png b.png --camera camera.toml
  pflut relpose a.png b.png --camera camera.toml --figure pair.png
  pflut relpose 3 4 --dataset zind/                images by number, with their true pose
  pflut relpose 000003.jpg 000004.jpg --dataset simulated-home --compare
"""


def add_parser(verbs: Subparsers) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs,
        "relpose",
        "estimate the relative pose of two images on the plane",
        usage="[options] A B (--camera FILE | --dataset DATASET)",
        details=_DETAILS,
        examples=_EXAMPLES,
    )
    parser.add_argument(
        "a",
        metavar="A",
        help="the reference image: a file; with --dataset an "
        "image of it, by number (from 0) or file name",
    )
    parser.add_argument("b", metavar="B", help="the query image, likewise")
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--camera", metavar="FILE", type=Path, help="camera file (TOML)")
    source.add_argument(
        "--dataset", metavar="DATASET", help="take the camera, and the true pose, from a dataset"
    )
    parser.add_argument(
        "--table",
        metavar="NAME|FILE",
        default="default",
        help="likelihood table: default; home, sharper and for rooms; perspective, for such "
        "cameras as sharp as a pixel; dense, the paper's; or a file of pflut lut build "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--detector",
        choices=("sift", "orb"),
        default="sift",
        help="of features (default: %(default)s)",
    )
    parser.add_argument(
        "--ratio",
        type=float,
        default=0.8,
        metavar="X",
        help="of the ratio test (default: %(default)s)",
    )
    parser.add_argument(
        "--mutual",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="matches must be each other's nearest (default: yes)",
    )
    parser.add_argument(
        "--noise",
        type=float,
        metavar="RADIANS",
        help="of the bearings, standard deviation (default: as the table has learned it; "
        "0.01 with the paper's)",
    )
    parser.add_argument(
        "--compare",
        action="store_true",
        help="print what RANSACs find in the same matches, too, with their times",
    )
    parser.add_argument(
        "--figure",
        metavar="FILE",
        type=Path,
        help="draw the matches to FILE (.png, .pdf, .svg) and the posterior to "
        "FILE with -posterior before its suffix",
    )
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> None:
    """Estimate and print."""
    import numpy as np

    from pflut.camera import load_camera
    from pflut.cli.loading import load
    from pflut.cli.progress import Bars
    from pflut.correspondences import Correspondences
    from pflut.features import FeatureExtractor, match_indices, read_image
    from pflut.geometry import relative_headings, rotation_from_headings, wrap_to_pi
    from pflut.likelihood.table import LikelihoodTable
    from pflut.mapping.link_evidence import link_evidence
    from pflut.mapping.link_model import LinkModel, link_model_name
    from pflut.pairs import agreeing
    from pflut.relpose.estimate import DEFAULT_NOISE, estimate_relative_pose
    from pflut.replay.tables import choose_table

    if arguments.figure is not None:
        from pflut.plot.style import check_figure_path

        check_figure_path(arguments.figure)
    with Bars() as bars:
        truth = None
        if arguments.camera is not None:
            camera, mask, mask_elevation = load_camera(arguments.camera), None, None
            paths = [Path(arguments.a), Path(arguments.b)]
        else:
            dataset = load(arguments.dataset, None, progress=bars)
            camera, mask = dataset.camera, dataset.mask
            mask_elevation = dataset.mask_elevation
            indices = [_index(dataset, name) for name in (arguments.a, arguments.b)]
            paths = [dataset.image_paths[i] for i in indices]
            if dataset.ground_truth is not None:
                truth = relative_headings(*dataset.ground_truth[indices])
        table = choose_table(arguments.table, camera=camera, progress=bars.stage("table"))
    extractor = FeatureExtractor(
        camera, detector=arguments.detector, mask_elevation=mask_elevation, mask=mask
    )
    images = [read_image(path) for path in paths]
    features = []
    for path, image in zip(paths, images, strict=True):
        try:
            features.append(extractor(image))
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
    left, right, score = match_indices(*features, ratio=arguments.ratio, mutual=arguments.mutual)
    matches = Correspondences(
        features[0].azimuth[left],
        features[0].elevation[left],
        features[1].azimuth[right],
        features[1].elevation[right],
        score,
    )
    noise = arguments.noise
    if noise is None:
        noise = table.noise if isinstance(table, LikelihoodTable) else DEFAULT_NOISE
    pose = estimate_relative_pose(matches, table, noise=noise)

    std_l, std_r = np.degrees(np.sqrt(np.diag(pose.covariance)))
    rows = [
        ("heading_l", pose.heading_l, std_l),
        ("heading_r", pose.heading_r, std_r),
        ("rotation", pose.rotation, np.degrees(pose.rotation_std)),
    ]
    print(f"features    {len(features[0])} and {len(features[1])}")
    print(f"matches     {len(matches)}, of which {pose.num_inliers} agree with the pose")
    for name, value, std in rows:
        print(f"{name:<12}{np.degrees(value):8.2f} deg   std {std:.2f} deg")
    if truth is not None and np.isfinite(truth).all():
        theta, phi, distance = truth
        angles = [
            np.degrees(wrap_to_pi(a)) for a in (theta, phi, rotation_from_headings(theta, phi))
        ]
        print(
            "truth       "
            + ", ".join(
                f"{name} {angle:.2f}" for (name, *_), angle in zip(rows, angles, strict=True)
            )
            + f" deg, {distance:.2f} m apart"
        )
    print(f"evidence    {pose.log_evidence:.1f} nat that the images show one scene")
    known = link_model_name(arguments.table, camera)
    if known is not None and isinstance(table, LikelihoodTable):
        model = LinkModel.default(known)
        (probability,) = model.probability(link_evidence([matches], table, poses=[pose]))
        sure = "> 0.999" if probability > 0.999 else f"{probability:.3f}"
        print(f"link        {sure} probable, where {model.prior:.2f} of all pairs are linked")
    print(f"success     {'yes' if pose.success else 'no: the matches do not determine a pose'}")
    if arguments.compare:
        _compare(matches, table, noise)

    if arguments.figure is not None:
        from pflut.plot import plot_correspondences, plot_posterior, save_figure
        from pflut.posterior import pose_posterior

        title = f"{paths[0].name} and {paths[1].name}: {len(matches)} matches"
        inliers = agreeing(matches, pose, noise=noise)
        save_figure(
            plot_correspondences(
                images[0],
                images[1],
                features[0].pixels[left],
                features[1].pixels[right],
                inliers=inliers,
                title=title,
            ),
            arguments.figure,
        )
        second = arguments.figure.with_stem(f"{arguments.figure.stem}-posterior")
        told = truth is not None and bool(np.isfinite(truth).all())
        save_figure(
            plot_posterior(
                pose_posterior(matches, table).log_prob,
                mode=(pose.heading_l, pose.heading_r),
                truth=truth[:2] if truth is not None and told else None,
                title=title,
            ),
            second,
        )
        print(f"figures     {arguments.figure}, {second}")


def _compare(matches: Correspondences, table: LikelihoodTable | DenseTable, noise: float) -> None:
    """Print what the table and RANSACs find in the same matches."""
    from time import perf_counter

    import numpy as np

    from pflut.comparison import by_ransac, by_table

    estimators = {"likelihood": by_table(table, noise=noise)}
    for solver, points in (("2pt", "2-point"), ("3pt", "3-point"), ("8pt", "8-point")):
        estimators[f"{points} RANSAC"] = by_ransac(solver=solver, noise=noise)
    print(
        f"\n{'':16}{'heading_l':>10}{'heading_r':>10}{'rotation':>10}  [deg]{'inliers':>9}", end=""
    )
    print(f"{'success':>9}{'ms':>8}")
    for name, estimate in estimators.items():
        estimate([matches])  # compiles
        start = perf_counter()
        (pose,) = estimate([matches])
        spent = 1e3 * (perf_counter() - start)
        angles = np.degrees([pose.heading_l, pose.heading_r, pose.rotation])
        nothing = pose.num_inliers == 0 and not pose.success
        line = "".join(f"{'-' if nothing else f'{angle:.2f}':>10}" for angle in angles)
        said = "yes" if pose.success else "no"
        print(f"{name:16}{line}       {pose.num_inliers:9}{said:>9}{spent:8.2f}")


def _index(dataset: Dataset, name: str) -> int:
    """Give the index of an image by its number or file name."""
    names = [path.name for path in dataset.image_paths]
    if name in names:
        return names.index(name)
    if name.isdecimal() and int(name) < len(names):
        return int(name)
    raise ValueError(
        f"{name}: no such image in {dataset.name}, expected a number from 0 to {len(names) - 1} or "
        f"a name such as {names[0]}"
    )
