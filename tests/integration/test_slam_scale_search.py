"""A map of the wrong scale, whose rig's views look at the same things."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from slam_worlds import small

from facetcam.evaluation.trajectory import scale_error
from facetcam.rig import Rig
from facetcam.simulation.drive import round_the_table, wheel_odometry
from facetcam.simulation.film import Film, renderer_of
from facetcam.simulation.room import furnished_room
from facetcam.slam import Slam
from facetcam.slam.scale.search import better_scale, found_elsewhere, rescale

ADAPTER = Path(__file__).parents[2] / "examples" / "designs" / "stereo-adapter-rig.yaml"


def test_a_map_of_the_wrong_scale_is_found_out_and_mended() -> None:
    drive = round_the_table(8)
    film = Film(small(Rig.load(ADAPTER), 800), renderer_of(furnished_room()), drive)
    slam, wheels = Slam(film.rig), wheel_odometry(drive)
    for image, time, wheel in zip(film, drive.times, wheels):
        slam.track(image, time, wheel)
    map, mapper, adjuster = slam._map, slam._parts.mapper, slam._parts.adjuster
    true = drive.poses[[int(np.argmin(np.abs(drive.times - k.timestamp))) for k in map.keyframes], :3, 3]
    assert abs(scale_error(map.poses()[:, :3, 3], true)) < 0.05
    for keyframe in map.keyframes:
        keyframe.odometry = None
    for factor in (0.45, 2.2):
        rescale(map, factor, slam._parts.optics)
        adjuster.adjust_coarsely()
        counts = found_elsewhere(map, adjuster.window, slam._parts.optics, slam.config)
        found = better_scale(counts)
        assert found is not None and (found > 1.5 if factor < 1.0 else found < 0.6)
        mapper.seek_scale()
        adjuster.adjust_all(last=True)
        assert abs(scale_error(map.poses()[:, :3, 3], true)) < 0.03
    handovers = mapper.handovers
    # Chosen sightings cannot hold a wrong scale: those sought at all scales deny it.
    for factor in (0.85, 1.15):
        rescale(map, factor, slam._parts.optics)
        adjuster.adjust_coarsely()
        for keyframe in map.keyframes:
            if keyframe.frame is not None:
                handovers.seek([keyframe])
        evidence = handovers.evidence()
        wrong = scale_error(map.poses()[:, :3, 3], true)
        assert evidence.points > 100 and evidence.tested(0.002) == np.inf
        assert abs(evidence.stretch + np.log1p(wrong)) < 0.03
        handovers.take_up()
        adjuster.adjust_all(last=True)
        assert abs(scale_error(map.poses()[:, :3, 3], true)) < 0.03
        assert np.isfinite(handovers.evidence().tested(adjuster.judge()))
    assert better_scale(found_elsewhere(map, adjuster.window, slam._parts.optics, slam.config)) is None
