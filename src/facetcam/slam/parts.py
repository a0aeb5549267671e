"""The parts of the system, put together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from facetcam.rig import Rig
from facetcam.slam.adjustment.adjuster import Adjuster
from facetcam.slam.camera.corner_finder import CornerFinder, FrontEnd, SiicfFeatures
from facetcam.slam.camera.optics import Optics
from facetcam.slam.config import SlamConfig
from facetcam.slam.map.map import Map
from facetcam.slam.map.places import Places
from facetcam.slam.mapping.atlas import Atlas
from facetcam.slam.mapping.grower import Grower
from facetcam.slam.mapping.loops import LoopCloser
from facetcam.slam.mapping.mapper import Mapper
from facetcam.slam.mapping.resumer import Resumer
from facetcam.slam.mapping.starter import Starter
from facetcam.slam.rig_check.audit import drawn_scale_sigma
from facetcam.slam.rig_check.check import RigCheck
from facetcam.slam.tracking.relocaliser import Relocaliser
from facetcam.slam.tracking.tracker import Tracker


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
    resumer: Resumer
    grower: Grower
    atlas: Atlas
    rig_check: RigCheck

    @property
    def metric(self) -> bool:
        """True where the images prove the scale of the map, and do not deny the rig that it comes from."""
        return self.known(self.grower.scale_sigma)[0]

    @property
    def scale_sigma(self) -> float:
        """Relative standard deviation of the scale, inf where the images cannot tell it or deny the rig."""
        return self.known(self.grower.scale_sigma)[1]

    def known(self, scale_sigma: float) -> tuple[bool, float]:
        """Whether the images prove the scale of a map of that sigma, and what is left of the sigma."""
        sigma = scale_sigma if self.rig_check.fits else np.inf
        return self.grower.proven(sigma), sigma

    def drawn_scale_sigma(self, pixel_sigma: float) -> float | None:
        """The sigma if the rig is but drawn (see `rig_check.audit`), where the scale is known."""
        return drawn_scale_sigma(self.optics, self.adjuster, pixel_sigma) if self.grower.metric else None

    @classmethod
    def assemble(cls, rig: Rig, config: SlamConfig, front_end: FrontEnd = SiicfFeatures) -> Self:
        """Put them together round an empty map."""
        optics, map, places = Optics(rig, config.seam_margin), Map(), Places()
        corners = CornerFinder(optics, config.features, front_end)
        core = _Core(optics, config, corners, map, places)
        aside = _Core(optics, config, corners, Map(), Places())
        loops = core.closer()
        rig_check = RigCheck(optics, config, corners)
        grower = Grower(map, places, core.mapper, core.adjuster, loops, rig_check, optics, config)
        return cls(
            optics=optics,
            map=map,
            places=places,
            adjuster=core.adjuster,
            mapper=core.mapper,
            tracker=core.tracker,
            loops=loops,
            starter=core.starter,
            resumer=Resumer(aside.starter, aside.map, map, core.mapper, corners),
            grower=grower,
            atlas=Atlas(
                map,
                places,
                core.adjuster,
                loops,
                grower,
                corners,
                optics.n_views,
                lambda map, places: _Core(optics, config, corners, map, places).closer(),
            ),
            rig_check=rig_check,
        )


class _Core:
    """What makes and tracks a map, the one of the run or one beside it."""

    def __init__(
        self, optics: Optics, config: SlamConfig, corners: CornerFinder, map: Map, places: Places
    ) -> None:
        self.map = map
        self._shared = optics, config, places
        self.adjuster = Adjuster(map, optics, config)
        self.mapper = Mapper(map, optics, config, corners, self.adjuster)
        self.relocaliser = Relocaliser(map, optics, config, corners, places)
        self.tracker = Tracker(map, optics, config, corners, self.relocaliser)
        self.starter = Starter(map, optics, config, corners, self.mapper, self.tracker)

    def closer(self) -> LoopCloser:
        """What closes the loops of the map."""
        return LoopCloser(self.map, *self._shared, self.relocaliser, self.tracker)
