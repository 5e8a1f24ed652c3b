"""pflut: visual Monte Carlo localization on the plane.

A look-up table of likelihoods, learned once, turns the point correspondences between the camera's
image and reference images taken at known poses into a full likelihood over relative poses; a
particle filter weights its poses with it. Names are imported when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pflut._lazy import lazy

if TYPE_CHECKING:
    from pflut.calibration import Coverage as Coverage
    from pflut.calibration import coverage as coverage
    from pflut.calibration import fit_temperature as fit_temperature
    from pflut.camera import load_camera as load_camera
    from pflut.correspondences import Correspondences as Correspondences
    from pflut.correspondences import ReferenceMatch as ReferenceMatch
    from pflut.datasets import load_dataset as load_dataset
    from pflut.datasets.base import Dataset as Dataset
    from pflut.features import FeatureExtractor as FeatureExtractor
    from pflut.features import Features as Features
    from pflut.features import match as match
    from pflut.features import match_many as match_many
    from pflut.likelihood.dense import DenseTable as DenseTable
    from pflut.likelihood.files import load_table as load_table
    from pflut.likelihood.table import LikelihoodTable as LikelihoodTable
    from pflut.localization.dead_reckoning import DeadReckoning as DeadReckoning
    from pflut.localization.estimate import Estimate as Estimate
    from pflut.localization.extended_kalman_filter import (
        ExtendedKalmanFilter as ExtendedKalmanFilter,
    )
    from pflut.localization.filter_state import FilterState as FilterState
    from pflut.localization.global_search import GlobalSearch as GlobalSearch
    from pflut.localization.localizer import Localizer as Localizer
    from pflut.localization.motion import DifferentialDrive as DifferentialDrive
    from pflut.localization.motion import Omnidirectional as Omnidirectional
    from pflut.localization.particle_filter import ParticleFilter as ParticleFilter
    from pflut.localization.proposals import ReferenceProposal as ReferenceProposal
    from pflut.localization.proposals import UniformProposal as UniformProposal
    from pflut.localization.recovery import Recovery as Recovery
    from pflut.localization.reference_image_model import ReferenceImageModel as ReferenceImageModel
    from pflut.localization.relative_pose_model import RelativePoseModel as RelativePoseModel
    from pflut.localization.resampling_policy import EffectiveSizeBelow as EffectiveSizeBelow
    from pflut.localization.resampling_policy import EveryUpdates as EveryUpdates
    from pflut.localization.resampling_policy import Moved as Moved
    from pflut.localization.sample_size import KLDSampling as KLDSampling
    from pflut.localization.unscented_kalman_filter import (
        UnscentedKalmanFilter as UnscentedKalmanFilter,
    )
    from pflut.mapping.all_pairs import all_pairs as all_pairs
    from pflut.mapping.constraint import PoseConstraint as PoseConstraint
    from pflut.mapping.constraint import extract_constraint as extract_constraint
    from pflut.mapping.g2o import read_g2o as read_g2o
    from pflut.mapping.g2o import write_g2o as write_g2o
    from pflut.mapping.graph_optimizer import OptimizedGraph as OptimizedGraph
    from pflut.mapping.graph_optimizer import optimize_graph as optimize_graph
    from pflut.mapping.link_evidence import LinkEvidence as LinkEvidence
    from pflut.mapping.link_evidence import link_evidence as link_evidence
    from pflut.mapping.link_model import LinkModel as LinkModel
    from pflut.mapping.links import Links as Links
    from pflut.mapping.map_errors import MapErrors as MapErrors
    from pflut.mapping.node_localizer import NodeLocalizer as NodeLocalizer
    from pflut.mapping.node_model import NodeModel as NodeModel
    from pflut.mapping.node_walk import NodeWalk as NodeWalk
    from pflut.mapping.pair_linker import LinkOptions as LinkOptions
    from pflut.mapping.pose_graph import PoseGraph as PoseGraph
    from pflut.mapping.topological_map import TopologicalMap as TopologicalMap
    from pflut.posterior import GridPosterior as GridPosterior
    from pflut.posterior import pose_posterior as pose_posterior
    from pflut.reference_map import ReferenceMap as ReferenceMap
    from pflut.relpose.estimate import estimate_relative_pose as estimate_relative_pose
    from pflut.relpose.ransac import ransac_relative_pose as ransac_relative_pose
    from pflut.relpose.ransac import ransac_relative_poses as ransac_relative_poses
    from pflut.relpose.refine import refine_relative_pose as refine_relative_pose
    from pflut.relpose.result import RelativePose as RelativePose
    from pflut.relpose.search import estimate_relative_poses as estimate_relative_poses
    from pflut.simulation.correspondences import CorrespondenceSimulator as CorrespondenceSimulator
    from pflut.trajectory import Trajectory as Trajectory
    from pflut.von_mises.distribution import VonMises as VonMises
    from pflut.von_mises.mixture import VonMisesMixture as VonMisesMixture

__version__ = "0.1.0"

_NAMES = {
    "Correspondences": "correspondences",
    "CorrespondenceSimulator": "simulation.correspondences",
    "Coverage": "calibration",
    "Dataset": "datasets.base",
    "DeadReckoning": "localization.dead_reckoning",
    "DifferentialDrive": "localization.motion",
    "EffectiveSizeBelow": "localization.resampling_policy",
    "Estimate": "localization.estimate",
    "EveryUpdates": "localization.resampling_policy",
    "ExtendedKalmanFilter": "localization.extended_kalman_filter",
    "FeatureExtractor": "features",
    "FilterState": "localization.filter_state",
    "Features": "features",
    "GlobalSearch": "localization.global_search",
    "GridPosterior": "posterior",
    "KLDSampling": "localization.sample_size",
    "LikelihoodTable": "likelihood.table",
    "DenseTable": "likelihood.dense",
    "LinkOptions": "mapping.pair_linker",
    "Links": "mapping.links",
    "load_table": "likelihood.files",
    "LinkEvidence": "mapping.link_evidence",
    "LinkModel": "mapping.link_model",
    "Localizer": "localization.localizer",
    "MapErrors": "mapping.map_errors",
    "Moved": "localization.resampling_policy",
    "NodeLocalizer": "mapping.node_localizer",
    "NodeModel": "mapping.node_model",
    "NodeWalk": "mapping.node_walk",
    "Omnidirectional": "localization.motion",
    "OptimizedGraph": "mapping.graph_optimizer",
    "ParticleFilter": "localization.particle_filter",
    "PoseConstraint": "mapping.constraint",
    "PoseGraph": "mapping.pose_graph",
    "Recovery": "localization.recovery",
    "ReferenceImageModel": "localization.reference_image_model",
    "ReferenceMap": "reference_map",
    "ReferenceMatch": "correspondences",
    "ReferenceProposal": "localization.proposals",
    "RelativePose": "relpose.result",
    "RelativePoseModel": "localization.relative_pose_model",
    "TopologicalMap": "mapping.topological_map",
    "Trajectory": "trajectory",
    "UniformProposal": "localization.proposals",
    "UnscentedKalmanFilter": "localization.unscented_kalman_filter",
    "VonMises": "von_mises.distribution",
    "VonMisesMixture": "von_mises.mixture",
    "all_pairs": "mapping.all_pairs",
    "coverage": "calibration",
    "estimate_relative_pose": "relpose.estimate",
    "estimate_relative_poses": "relpose.search",
    "extract_constraint": "mapping.constraint",
    "fit_temperature": "calibration",
    "link_evidence": "mapping.link_evidence",
    "load_camera": "camera",
    "load_dataset": "datasets",
    "match": "features",
    "match_many": "features",
    "optimize_graph": "mapping.graph_optimizer",
    "pose_posterior": "posterior",
    "ransac_relative_pose": "relpose.ransac",
    "ransac_relative_poses": "relpose.ransac",
    "read_g2o": "mapping.g2o",
    "refine_relative_pose": "relpose.refine",
    "write_g2o": "mapping.g2o",
}

__getattr__, __dir__, __all__ = lazy(__name__, _NAMES)
