"""The parts of the system, put together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from facetcam.rig import Rig
from facetcam.slam.adjustment import Adjuster
from facetcam.slam.config import SlamConfig
from facetcam.slam.frame import CornerFinder, FrontEnd, SiicfFeatures
from facetcam.slam.growing import Grower
from facetcam.slam.loops import LoopCloser
from facetcam.slam.map import Map
from facetcam.slam.mapping import Mapper
from facetcam.slam.optics import Optics
from facetcam.slam.places import Places
from facetcam.slam.relocalisation import Relocaliser
from facetcam.slam.rig_check import RigCheck
from facetcam.slam.starting import Starter
from facetcam.slam.tracking import Tracker


@dataclass(frozen=True, slots=True)
class Parts:
    """What shares one map."""

    optics: Optics
    map: Map
    places: Places
    adjuster: Adjuster
    mapper: Mapper
    tracker: Tracker
    loops: LoopCloser
    starter: Starter
    grower: Grower
    rig_check: RigCheck

    @classmethod
    def assemble(cls, rig: Rig, config: SlamConfig, front_end: FrontEnd = SiicfFeatures) -> Self:
        """Put them together round an empty map."""
        optics, map, places = Optics(rig, config.seam_margin), Map(), Places()
        corners = CornerFinder(optics, config.features, front_end)
        adjuster = Adjuster(map, optics, config)
        mapper = Mapper(map, optics, config, corners, adjuster)
        relocaliser = Relocaliser(map, optics, config, corners, places)
        tracker = Tracker(map, optics, config, corners, relocaliser)
        loops = LoopCloser(map, optics, config, places, relocaliser, tracker)
        return cls(
            optics=optics,
            map=map,
            places=places,
            adjuster=adjuster,
            mapper=mapper,
            tracker=tracker,
            loops=loops,
            starter=Starter(map, optics, config, corners, mapper, tracker),
            grower=Grower(map, places, mapper, adjuster, loops, config),
            rig_check=RigCheck(optics, config, corners),
        )
