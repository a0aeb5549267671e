"""Which poses are believed after a loss, or a jump."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.camera.frame import Corners
from facetcam.slam.camera.pose import Pose
from facetcam.slam.map.map import Keyframe
from facetcam.slam.map.measure import Measurements, Predictions
from facetcam.slam.tracking.fix import Fix, better, likelier
from facetcam.slam.tracking.motion import Motion
from facetcam.slam.tracking.trust import Reckoning, Trust

Array = NDArray[np.float64]

SHARP, BLUNT = 0.3, 2.0  # pixels


def fix(seen: list[int], expected: list[int], residual: float, position: float = 0.0) -> Fix:
    """A pose with so many measurements and predictions in each view."""
    T = np.eye(4)
    T[0, 3] = position
    rows = [np.repeat(np.arange(len(n), dtype=np.int8), n) for n in (seen, expected)]
    n_seen, n_expected = (len(r) for r in rows)
    nothing = np.zeros((n_expected, 2, 2))
    return Fix(
        Pose(T, np.eye(6), np.full(n_seen, residual)),
        Predictions(np.arange(n_expected), rows[1], nothing[:, 0], nothing),
        Measurements(np.arange(n_seen), rows[0], np.zeros((n_seen, 2)), np.zeros((n_seen, 2))),
    )


def doubting(n_views: int = 4) -> Trust:
    trust = Trust(n_views)
    trust.lose()
    return trust


def test_every_pose_is_believed_while_tracking() -> None:
    assert Trust(4).believes(fix([15, 0, 0, 0], [200, 200, 200, 200], BLUNT))


def test_a_look_alike_with_more_measurements_does_not_win() -> None:
    """As seen on a film: metres away little of what is expected is found, but more than near by."""
    near, look_alike = fix([25, 0, 0, 6], [43, 4, 0, 21], SHARP), fix([0, 36, 0, 0], [0, 159, 80, 2], BLUNT)
    assert better(look_alike, near) is near
    assert better(near, look_alike) is near
    assert better(None, look_alike) is look_alike
    assert better(near, fix([60, 0, 0, 20], [80, 0, 0, 30], SHARP)) is not near


def test_a_likely_pose_where_the_rig_is_expected_yields_to_no_look_alike() -> None:
    """Floors and walls repeat: the same tiles metres away may show more."""
    near, elsewhere = fix([60, 20], [140, 50], SHARP), fix([90, 40], [140, 50], SHARP, position=3.4)
    assert likelier(near, elsewhere) is near
    beside = fix([90, 40], [140, 50], SHARP, position=0.1)
    assert likelier(near, beside) is beside
    unlikely = fix([20, 10], [140, 50], SHARP)
    assert likelier(unlikely, elsewhere) is elsewhere
    assert likelier(None, elsewhere) is elsewhere and likelier(near, None) is near


def test_it_yields_to_a_clear_pose_that_is_far_better() -> None:
    """As seen in a saved map: what was expected was found in one view of four, with 38 of 100 points."""
    near, there = fix([25, 33], [97, 56], SHARP), fix([88, 54], [91, 54], SHARP, position=0.24)
    assert likelier(near, there) is there
    assert likelier(fix([60, 40], [97, 56], SHARP), there) is not there  # clear itself
    assert likelier(near, fix([88, 54], [250, 120], SHARP, position=0.24)) is near  # most of it is missing


def test_a_jump_needs_a_second_view_or_wheels() -> None:
    """Tracking that is not lost may still slide on to a look-alike, in one view or with few in each."""
    one_view, expected = [0, 60, 0, 0], [60, 80, 60, 60]
    for poor in (fix(one_view, expected, SHARP), fix([12, 15, 6, 9], [200] * 4, BLUNT)):
        assert not Trust(4).believes(poor, jumps=True)
    assert Trust(4).believes(fix([30, 60, 0, 0], expected, BLUNT), jumps=True)


def driven(speed: float, interval: float) -> tuple[Motion, list[Array]]:
    """A rig that has driven straight ahead, and where it is expected an interval later."""
    motion, keyframe = Motion(), Keyframe(0, 0.0, np.eye(4), Corners.none(), None, None)
    for k in range(3):
        way = se3.exp([0.0, 0.0, 0.0, 0.0, k * speed * interval, 0.0])
        motion.follow(k * interval, Fix(Pose(way, np.eye(6), np.zeros(0)), *nothing_seen()), keyframe, None)
    return motion, motion.predictions(3 * interval, None)


def nothing_seen() -> tuple[Predictions, Measurements]:
    seen = fix([0], [0], SHARP)
    return seen.predictions, seen.seen


@pytest.mark.parametrize(
    ("interval", "aside", "turn", "jumps"),
    [
        (0.1, 0.1, 0.0, False),
        (0.1, 0.3, 0.0, True),
        (0.1, 0.0, 0.2, False),
        (0.1, 0.0, 0.5, True),
        (0.5, 1.0, 1.5, False),
        (0.033, 0.15, 0.0, True),
    ],
)
def test_a_jump_is_what_no_rig_can_do(interval: float, aside: float, turn: float, jumps: bool) -> None:
    motion, expected = driven(0.7, interval)
    there = expected[0] @ se3.exp([0.0, 0.0, turn, aside, 0.0, 0.0])
    assert motion.jumps(3 * interval, there, expected) is jumps
    assert not motion.jumps(3 * interval, there, [*expected, there])  # wheels say the same
    motion.lose(None, False, False)
    assert not motion.jumps(3 * interval, there, expected)  # doubted already


@pytest.mark.parametrize(
    ("aside", "turn", "later", "beside"),
    [(0.1, 0.1, 0.1, True), (0.3, 0.0, 0.1, False), (0.0, 0.3, 0.1, False), (0.0, 0.0, 1.5, False)],
)
def test_a_rig_lost_a_moment_ago_is_beside_where_it_was_going(
    aside: float, turn: float, later: float, beside: bool
) -> None:
    motion, _ = driven(0.7, 0.1)
    motion.lose(None, False, False)
    expected = motion.predictions(0.2 + later, None)
    there = expected[0] @ se3.exp([0.0, 0.0, turn, aside, 0.0, 0.0])
    assert motion.is_beside(0.2 + later, there, expected) is beside


def test_beside_its_way_a_clear_pose_is_believed_at_once() -> None:
    one_view, expected = fix([0, 60, 0, 0], [5, 80, 5, 5], BLUNT), [60, 80, 60, 60]
    assert doubting().believes(one_view, beside=True)
    assert not doubting().believes(one_view)
    assert not doubting().believes(fix([0, 60, 0, 0], expected, BLUNT), beside=True)


@pytest.mark.parametrize("residual", [SHARP, BLUNT])
def test_two_views_confirm_though_a_wall_hides_what_others_expect(residual: float) -> None:
    assert doubting().believes(fix([10, 16, 0, 18], [14, 21, 0, 160], residual))


@pytest.mark.parametrize("seen", [[0, 90, 0, 0], [3, 90, 4, 2]])
def test_one_view_alone_may_be_fooled(seen: list[int]) -> None:
    assert not doubting().believes(fix(seen, [60, 100, 60, 60], SHARP))


def test_a_few_measurements_here_and_there_are_chance() -> None:
    assert not doubting().believes(fix([12, 15, 6, 9], [200, 200, 200, 200], BLUNT))


def test_a_sharp_pose_found_three_times_is_believed() -> None:
    trust, one_view = doubting(), [0, 40, 0, 0]
    assert [trust.believes(fix(one_view, [60, 60, 60, 60], SHARP, 0.05 * k)) for k in range(3)] == [
        False,
        False,
        True,
    ]


def test_poses_that_jump_are_not_believed() -> None:
    trust = doubting()
    assert not any(trust.believes(fix([0, 40, 0, 0], [60] * 4, SHARP, 1.0 * k)) for k in range(6))


def test_a_blunt_pose_in_one_view_is_never_believed() -> None:
    trust = doubting()
    assert not any(trust.believes(fix([0, 40, 0, 0], [60] * 4, BLUNT)) for _ in range(6))


def test_a_sharp_pose_that_no_view_bears_out_is_never_believed() -> None:
    """As seen of a flat wall: a tenth of the points at a place four metres off, frame after frame."""
    trust = doubting()
    assert not any(trust.believes(fix([0, 0, 0, 18], [4, 0, 0, 139], SHARP)) for _ in range(6))


def test_wheels_bear_witness() -> None:
    one_view = [0, 40, 0, 0]
    here = Reckoning(np.eye(4), way=1.0)
    assert doubting().believes(fix(one_view, [60] * 4, SHARP, 0.1), here)
    assert not doubting().believes(fix(one_view, [60] * 4, BLUNT, 0.1), here)


def test_sharp_poses_that_go_on_from_a_believed_one_are_believed() -> None:
    trust = doubting()
    assert trust.believes(fix([10, 16, 0, 18], [14, 21, 0, 160], BLUNT))
    trust.accept()
    assert trust.believes(fix([0, 40, 0, 0], [60] * 4, SHARP, 0.1))
    assert not trust.believes(fix([0, 40, 0, 0], [60] * 4, SHARP, 1.0))


@pytest.mark.parametrize("residual", [SHARP, BLUNT])
def test_what_the_wheels_deny_must_be_seen_again_and_again(residual: float) -> None:
    """A robot that was carried off is found, a look-alike of a few frames is not believed."""
    trust, elsewhere = doubting(), Reckoning(np.eye(4), way=1.0)
    carried = fix([10, 16, 0, 18], [14, 21, 0, 160], residual, 0.3)
    assert [trust.believes(carried, elsewhere) for _ in range(6)] == 5 * [False] + [True]


def test_wheels_that_are_not_proven_yet_second_nobody_but_deny_look_alikes() -> None:
    """Lost in its first seconds a rig had been taken to what one view saw, a metre from where it went."""
    wheels, one_view, two_views = Reckoning(np.eye(4), way=1.0, proven=False), [0, 40, 0, 0], [0, 40, 0, 30]
    trust = doubting()
    assert not any(trust.believes(fix(one_view, [60] * 4, SHARP, 1.0), wheels) for _ in range(20))
    assert doubting().believes(fix(two_views, [60] * 4, SHARP, 1.0), wheels)
    trust = doubting()  # where they say the same it is as without wheels
    near = fix(one_view, [60] * 4, SHARP, 0.1)
    assert [trust.believes(near, wheels) for _ in range(3)] == [False, False, True]


@pytest.mark.parametrize(("foretell", "proven"), [(True, True), (True, False), (False, False)])
def test_a_lost_rig_is_reckoned_by_wheels_that_nothing_has_refuted(foretell: bool, proven: bool) -> None:
    motion, _ = driven(0.7, 0.1)
    motion.odometry = np.zeros(3)
    motion.lose(np.zeros(3), foretell, proven)
    reckoned = motion.reckoned(np.zeros(3))
    assert (reckoned is not None) == foretell
    assert reckoned is None or reckoned.proven == proven
    assert motion.stands == proven  # they alone tell that somebody has carried the rig


def test_reckoning_allows_wheels_a_tenth_of_the_way() -> None:
    ahead = np.eye(4)
    ahead[1, 3] = 0.5
    there = Reckoning(np.eye(4)).further(ahead).further(ahead)
    np.testing.assert_allclose(there.T_world_rig[:3, 3], [0.0, 1.0, 0.0])
    near, far = np.eye(4), np.eye(4)
    near[1, 3], far[1, 3] = 1.14, 1.16
    assert there.agrees(near)
    assert not there.agrees(far)


@pytest.mark.parametrize(("residual", "believed"), [(SHARP, True), (BLUNT, False)])
def test_a_rig_of_one_view_must_be_sharp(residual: float, believed: bool) -> None:
    assert doubting(1).believes(fix([60], [100], residual)) is believed


def test_doubt_ends_after_five_good_frames() -> None:
    trust, poor = doubting(), fix([0, 20, 0, 0], [200] * 4, BLUNT)
    for _ in range(5):
        assert not trust.believes(poor)
        trust.accept()
    assert trust.believes(poor)


@pytest.mark.parametrize(
    ("seen", "expected", "residual", "borne_out"),
    [
        (
            [7, 0, 0, 8],
            [34, 3, 0, 78],
            BLUNT,
            False,
        ),  # chance found so many on a film that went astray
        ([7, 0, 0, 8], [34, 3, 0, 78], SHARP, True),  # but they do not agree so well
        ([0, 0, 0, 27], [0, 75, 6, 88], BLUNT, True),  # one view finds enough of its own
        ([4, 0, 0, 0], [6, 40, 40, 40], BLUNT, False),  # and four points are no view
        ([10, 10, 10, 10], [45, 45, 45, 45], BLUNT, True),  # a good part of everything, as in the dark
    ],
)
def test_a_pose_that_nothing_bears_out_is_none(
    seen: list[int], expected: list[int], residual: float, borne_out: bool
) -> None:
    assert fix(seen, expected, residual).borne_out is borne_out


@pytest.mark.parametrize(("aside", "believed"), [(1.5, [False] * 5 + [True]), (6.0, [False] * 6)])
def test_what_no_slip_explains_needs_a_second_view(aside: float, believed: list[bool]) -> None:
    """Four metres by the wheels: they may have slipped by a third, but not have gone another way."""
    trust, wheels = doubting(), Reckoning(np.eye(4), way=4.0, turn=0.5)
    one_view, two_views = ([40, n, 0, 0] for n in (0, 30))
    found = [trust.believes(fix(one_view, [60] * 4, SHARP, aside), wheels) for _ in range(6)]
    assert found == believed
    assert trust.believes(fix(two_views, [60] * 4, SHARP, aside), wheels)
