"""Corners, their descriptors and their matching."""

from facetcam.features.baselines import DoG, HarrisLaplace, LoG
from facetcam.features.descriptors import describe
from facetcam.features.keypoints import Keypoints
from facetcam.features.matching import match_mutual, match_windowed
from facetcam.features.siicf import SIICF

__all__ = ["SIICF", "DoG", "HarrisLaplace", "Keypoints", "LoG", "describe", "match_mutual", "match_windowed"]
