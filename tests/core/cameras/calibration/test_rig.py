from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.calibration.bench_rig import BallSwing, click_corners, seen_by
from core.cameras import Camera, stereo_preset
from core.cameras.calibration.body_tracks import body_tracks
from core.cameras.calibration.bundle import Rig
from core.cameras.calibration.point_track import PointTrack
from core.cameras.calibration.rig import RigConfig, calibrate_rig, choose_instants
from core.cameras.calibration.rig_chain import guess_rig
from core.cameras.calibration.rig_result import RigCalibration
from core.cameras.calibration.scale import Scale
from core.cameras.calibration.table_corners import Clicks
from core.errors import CalibrationError
from core.geometry import invert_transform, look_at
from core.simulation.flights import LaunchConfig, draw_serve_series

pytestmark = pytest.mark.numeric
CAMERAS = stereo_preset("side")
LENSES = {name: replace(camera, T_world_camera=np.eye(4)) for name, camera in CAMERAS.items()}
QUICK = RigConfig(max_offset_ms=3.0, instants=300)


def calibrate(
    tracks: Mapping[str, PointTrack],
    lenses: Mapping[str, Camera],
    scale: Scale,
    *,
    clicks: Mapping[str, Clicks] | None = None,
    ball: bool = True,
    config: RigConfig = QUICK,
) -> RigCalibration:
    """The rig of what was swept: a ball, or a wand if that is the scale."""
    return calibrate_rig(body_tracks(tracks, scale.body_m), lenses, scale, clicks=clicks, ball=ball, config=config)


def sweep(
    cameras: Mapping[str, Camera],
    path,
    *,
    ahead_us: int = 1700,
    noise_px: float = 0.4,
    stray: float = 0.02,
    seed: int = 0,
) -> dict[str, PointTrack]:
    """What the cameras say; the clocks of all but the first are ahead."""
    rng = np.random.default_rng(seed)
    return {
        name: seen_by(camera, path, rng, noise_px=noise_px, clock_ahead_us=ahead_us if number else 0, stray_share=stray)
        for number, (name, camera) in enumerate(cameras.items())
    }


def relative(cameras: Mapping[str, Camera], name: str) -> np.ndarray:
    first = next(iter(cameras.values()))
    return invert_transform(first.T_world_camera) @ cameras[name].T_world_camera


def turned_deg(a: np.ndarray, b: np.ndarray) -> float:
    cosine = (np.trace(a[:3, :3].T @ b[:3, :3]) - 1) / 2
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def off_mm(found: RigCalibration, path) -> np.ndarray:
    """Distances of the points from where the ball was."""
    true = path.at(found.t_us * 1e-6).p_world_m
    return 1e3 * np.linalg.norm(found.points_m[:, 0] - true, axis=1)[found.used]


def off_relative_mm(found: RigCalibration, path) -> np.ndarray:
    """The same in the first camera's frame."""
    first = next(iter(found.cameras.values()))
    T_found, T_true = invert_transform(first.T_world_camera), invert_transform(CAMERAS["left"].T_world_camera)
    true = path.at(found.t_us * 1e-6).p_world_m @ T_true[:3, :3].T + T_true[:3, 3]
    got = found.points_m[:, 0] @ T_found[:3, :3].T + T_found[:3, 3]
    return 1e3 * np.linalg.norm(got - true, axis=1)[found.used]


@pytest.fixture(scope="module")
def swung() -> RigCalibration:
    tracks = sweep(CAMERAS, BallSwing(5.0))
    clicks = click_corners(CAMERAS, np.random.default_rng(1), 0.5)
    return calibrate(tracks, LENSES, Scale("table"), clicks=clicks, config=QUICK)


def test_a_swung_ball_and_the_tables_corners_give_the_rig_its_place_and_its_clocks(swung: RigCalibration) -> None:
    assert swung.reports["right"].offset_us == pytest.approx(1700, abs=40) and swung.reports["left"].offset_us == 0
    for name, camera in swung.cameras.items():
        assert np.linalg.norm(camera.position_world_m - CAMERAS[name].position_world_m) < 0.006
        assert turned_deg(camera.T_world_camera, CAMERAS[name].T_world_camera) < 0.1
    assert np.median(off_mm(swung, BallSwing(5.0))) < 2.0
    assert swung.click_rms_px is not None and swung.click_rms_px < 1.0 and swung.notes == ()


def test_what_is_reported_of_the_residuals_is_what_the_cameras_give(swung: RigCalibration) -> None:
    for fit in swung.reports.values():
        again = fit.uvs_px[:, 0] - fit.camera.project(swung.points_m[:, 0])
        np.testing.assert_allclose(fit.residuals_px[:, 0], again, equal_nan=True)
        assert 0.1 < np.sqrt(np.nanmean(fit.residuals_px[swung.used] ** 2)) < 0.3, "half of the noise leaves a residual"
    assert abs(swung.lead_px) < 4 * swung.sigma_lead_px < 0.5
    assert 0.36 < swung.sigma_px < 0.42, "0.4 px, a little of it smoothed between sightings"


def test_standard_deviations_are_honest() -> None:
    # The relative pose and the clock over several sweeps; the baseline's length is given.
    scores = []
    true = relative(CAMERAS, "right")
    for seed in range(5):
        tracks = sweep(CAMERAS, BallSwing(2.5), seed=seed, stray=0.0)
        found = calibrate(tracks, LENSES, Scale("baseline", 3.5), config=QUICK)
        fit, got = found.reports["right"], relative(found.cameras, "right")
        scores.append((fit.offset_us - 1700) / fit.sigma_offset_us)
        scores.append(np.linalg.norm(got[:3, 3] - true[:3, 3]) / fit.sigma_position_m)
        scores.append(np.radians(turned_deg(got, true)) / fit.sigma_rotation_rad)
    assert 0.5 < np.sqrt(np.mean(np.square(scores))) < 1.8


@pytest.fixture(scope="module")
def served():
    configs = [LaunchConfig(speed_mps=speed, yaw_spread_deg=6.0) for speed in (4, 5, 6, 5, 7, 4)]
    return draw_serve_series(configs, np.random.default_rng(3))


def test_free_flight_tells_the_scale_and_which_way_is_up(served) -> None:
    config = replace(QUICK, instants=1000)
    found = calibrate(sweep(CAMERAS, served), LENSES, Scale("gravity", drag_per_m=0.0), config=config)
    assert found.baseline_m == pytest.approx(3.5, rel=0.005)
    assert found.sigma_baseline_m < 0.02 and "arcs" in found.scale.origin
    left, right = found.cameras.values()
    np.testing.assert_allclose(left.position_world_m, 0.0, atol=1e-12)
    assert right.position_world_m[2] == pytest.approx(0.0, abs=0.02), "both stand 1.15 m high"
    down = left.T_world_camera[:3, :3].T @ [0, 0, -1.0]
    expected = CAMERAS["left"].T_world_camera[:3, :3].T @ [0, 0, -1.0]
    assert np.degrees(np.arccos(down @ expected)) < 0.3
    assert abs(left.T_world_camera[1, 2]) < 1e-9 and left.T_world_camera[0, 2] > 0, "x is where it looks"


def test_a_given_baseline_is_kept_beside_the_corners(served) -> None:
    clicks = click_corners(CAMERAS, np.random.default_rng(1), 0.5)
    found = calibrate(sweep(CAMERAS, served), LENSES, Scale("baseline", 3.5), clicks=clicks, config=QUICK)
    assert found.baseline_m == pytest.approx(3.5, abs=0.001) and "corners" in found.frame
    assert found.sigma_baseline_m == pytest.approx(3.5e-4, rel=0.1), "taken as known to a ten-thousandth"
    assert np.median(off_mm(found, served)) < 2.5


def test_the_length_of_a_wand_is_the_scale() -> None:
    swing = BallSwing(5.0)
    rng = np.random.default_rng(0)
    t_us = np.arange(2000, 5_000_000, 2000)
    tracks = {}
    for number, (name, camera) in enumerate(CAMERAS.items()):
        middle = swing.at((t_us - 1700 * number) * 1e-6).p_world_m
        turn = (t_us - 1700 * number) * 3e-6
        half = 0.2 * np.column_stack([np.cos(turn), np.sin(turn) * 0.8, np.sin(turn) * 0.6])
        uvs = np.concatenate([camera.project(middle + half), camera.project(middle - half)])
        tracks[name] = PointTrack.of(
            np.tile(t_us, 2), uvs + rng.normal(0, 0.3, uvs.shape), np.repeat([0, 1], len(t_us))
        )
    found = calibrate(tracks, LENSES, Scale("wand", 0.4), ball=False, config=QUICK)
    assert found.baseline_m == pytest.approx(3.5, rel=0.003)
    assert found.reports["right"].offset_us == pytest.approx(1700, abs=40)


def wand_before(offset_m: float, seed: int) -> dict[str, PointTrack]:
    """A turning wand with markers 0 and 1, 0.4 m apart, and a third one `offset_m` beside its middle; 0.3 px."""
    swing, rng = BallSwing(5.0), np.random.default_rng(seed)
    t_us = np.arange(2000, 5_000_000, 2000)
    tracks = {}
    for number, (name, camera) in enumerate(CAMERAS.items()):
        middle = swing.at((t_us - 1700 * number) * 1e-6).p_world_m
        turn = (t_us - 1700 * number) * 3e-6
        along = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(len(turn))])
        places = np.concatenate([middle + 0.2 * along, middle - 0.2 * along, middle + np.array([0.0, 0.0, offset_m])])
        uvs = camera.project(places)
        tracks[name] = PointTrack.of(
            np.tile(t_us, 3), uvs + rng.normal(0, 0.3, uvs.shape), np.repeat([0, 1, 2], len(t_us))
        )
    return tracks


def test_markers_whose_places_are_not_known_are_points_of_their_own() -> None:
    tracks = wand_before(0.1, 0)
    found = calibrate(tracks, LENSES, Scale("baseline", 3.5), ball=False, config=QUICK)
    assert found.points_m.shape[1] == 1 and len(found.t_us) == 3 * QUICK.instants
    got, true = relative(found.cameras, "right"), relative(CAMERAS, "right")
    assert np.linalg.norm(got[:3, 3] - true[:3, 3]) < 0.004 and turned_deg(got, true) < 0.05
    ends = found.points_m[:, 0].reshape(-1, 3, 3)
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    assert np.nanmedian(lengths) == pytest.approx(0.4, abs=0.001), "0 and 1 of the same instant stand together"


def test_how_well_the_baseline_is_known_by_a_wand() -> None:
    scores = []
    for seed in range(5):
        found = calibrate(wand_before(0.1, seed), LENSES, Scale("wand", 0.4), ball=False, config=QUICK)
        scores.append((found.baseline_m - 3.5) / found.sigma_baseline_m)
    assert 0.3 < np.sqrt(np.mean(np.square(scores))) < 2.0


def test_twenty_common_times_of_both_ends_are_enough_and_fewer_are_not() -> None:
    tracks = wand_before(0.1, 0)
    for count, fine in ((22, True), (21, False)):  # the first and the last have no neighbours that say how they move
        few = {
            name: PointTrack(track.t_us[keep], track.uvs_px[keep], track.marker[keep])
            for name, track in tracks.items()
            for keep in [(track.marker == 0) | ((track.marker == 1) & (track.t_us <= 2000 * count))]
        }
        bodies = body_tracks(few, Scale("wand", 0.4).body_m, clean=False)
        if fine:
            rig = guess_rig(bodies, list(LENSES.values()), np.array([1700.0]))
            assert rig.baseline == pytest.approx(3.5, rel=0.02)
        else:
            with pytest.raises(CalibrationError, match=r"too little of the wand.* got 19"):
                guess_rig(bodies, list(LENSES.values()), np.array([1700.0]))


def test_clocks_may_be_farther_apart_than_the_sweep_is_long() -> None:
    tracks = sweep(CAMERAS, BallSwing(1.5), ahead_us=0, stray=0.0)
    tracks["right"] = replace(tracks["right"], t_us=tracks["right"].t_us + 1_600_000)
    rig = guess_rig(body_tracks(tracks, np.zeros((1, 3))), list(LENSES.values()), np.array([-1.6e6, 0.0, 1.6e6]))
    assert rig.offsets_us.tolist() == [0.0, 1.6e6]
    assert turned_deg(invert_transform(rig.poses[0]) @ rig.poses[1], relative(CAMERAS, "right")) < 0.5


def test_a_third_camera_is_brought_to_the_same_scale_and_has_its_own_clock() -> None:
    three = {**CAMERAS, "top": replace(CAMERAS["left"], T_world_camera=look_at((-1.3, 0.2, 2.3), (-0.5, 0.0, 0.1)))}
    lenses = {name: replace(camera, T_world_camera=np.eye(4)) for name, camera in three.items()}
    config = replace(QUICK, instants=800)
    found = calibrate(sweep(three, BallSwing(4.0)), lenses, Scale("baseline", 3.5), config=config)
    got, true = relative(found.cameras, "top"), relative(three, "top")
    assert np.linalg.norm(got[:3, 3] - true[:3, 3]) < 0.01 and turned_deg(got, true) < 0.1
    assert found.reports["top"].offset_us == pytest.approx(1700, abs=60)


def test_detections_that_run_ahead_of_the_ball_are_found_out() -> None:
    rng = np.random.default_rng(0)
    swing = BallSwing(3.0)
    tracks = {name: seen_by(camera, swing, rng, noise_px=0.4, lead_px=3.0) for name, camera in CAMERAS.items()}
    found = calibrate(tracks, LENSES, Scale("baseline", 3.5), config=QUICK)
    assert found.lead_px == pytest.approx(3.0, abs=0.3) and found.sigma_lead_px < 0.2
    got, true = relative(found.cameras, "right"), relative(CAMERAS, "right")
    assert np.linalg.norm(got[:3, 3] - true[:3, 3]) < 0.005 and turned_deg(got, true) < 0.06
    assert abs(found.reports["right"].offset_us) < 60


def test_the_instants_are_those_of_the_first_camera() -> None:
    rng = np.random.default_rng(0)
    swing = BallSwing(3.0)
    every = {"left": 2000, "right": 6000}
    tracks = {
        name: seen_by(camera, swing, rng, noise_px=0.4, every_us=every[name], clock_ahead_us=1700 * (name == "right"))
        for name, camera in CAMERAS.items()
    }
    config = RigConfig(max_offset_ms=3.0, instants=900)
    found = calibrate(tracks, LENSES, Scale("baseline", 3.5), config=config)
    assert len(tracks["right"].t_us) < 500 < len(found.t_us) == 900
    assert np.median(off_relative_mm(found, swing)) < 6.0


def test_instants_of_two_cameras_make_up_for_a_third_that_saw_little() -> None:
    seen = [PointTrack.of(t_us, np.column_stack([3e-3 * t_us, 1e-8 * t_us**2])) for t_us in
            (2000 * np.arange(200), 2000 * np.arange(200), 2000 * np.arange(20))]  # fmt: skip
    tracks = body_tracks(dict(zip("abc", seen, strict=True)), np.zeros((1, 3)), clean=False)
    rig = Rig((LENSES["left"],) * 3, np.zeros(3), np.zeros(3))
    chosen = choose_instants(tracks, rig, 90)
    assert len(chosen) == 90 and (np.diff(chosen) > 0).all() and chosen[-1] > 390_000


def test_one_clock_means_no_offset() -> None:
    tracks = sweep(CAMERAS, BallSwing(3.0), ahead_us=0)
    found = calibrate(tracks, LENSES, Scale("baseline", 3.5), config=replace(QUICK, max_offset_ms=0.0))
    fit = found.reports["right"]
    assert fit.offset_us == 0 and fit.sigma_offset_us == 0
    assert np.linalg.norm(relative(found.cameras, "right")[:3, 3] - relative(CAMERAS, "right")[:3, 3]) < 0.004


def test_the_same_sightings_give_the_same_rig() -> None:
    tracks = sweep(CAMERAS, BallSwing(2.0))
    first, second = (calibrate(tracks, LENSES, Scale("baseline", 3.5), config=QUICK) for _ in range(2))
    for name, camera in first.cameras.items():
        np.testing.assert_array_equal(camera.T_world_camera, second.cameras[name].T_world_camera)


def test_a_misplaced_click_is_named() -> None:
    clicks = click_corners(CAMERAS, np.random.default_rng(1), 0.5)
    left = clicks["left"]
    uvs = left.uvs_px.copy()
    uvs[left.names.index("net-left")] += 25.0
    wrong = {**clicks, "left": Clicks(left.names, uvs)}
    tracks = sweep(CAMERAS, BallSwing(2.0))
    found = calibrate(tracks, LENSES, Scale("baseline", 3.5), clicks=wrong, config=QUICK)
    assert any("the corner net-left of left is" in note for note in found.notes)


def test_corners_with_each_others_names_are_refused() -> None:
    clicks = click_corners(CAMERAS, np.random.default_rng(1), 0.5)
    left = clicks["left"]
    wrong = {"left": Clicks(tuple(reversed(left.names)), left.uvs_px)}
    with pytest.raises(CalibrationError, match=r"not those of a table|no camera above"):
        calibrate(sweep(CAMERAS, BallSwing(2.0)), LENSES, Scale("baseline", 3.5), clicks=wrong, config=QUICK)


def test_a_sweep_in_one_plane_is_refused_because_two_poses_fit_it() -> None:
    tracks = sweep(CAMERAS, BallSwing(2.0, reach_m=(0.6, 0.001, 0.28)))
    with pytest.raises(CalibrationError, match="one plane only"):
        calibrate(tracks, LENSES, Scale("baseline", 3.5), config=QUICK)


@pytest.mark.parametrize(
    ("spoil", "scale", "says"),
    [
        (lambda tracks: {"left": tracks["left"]}, Scale("baseline", 3.5), "tracks of two cameras"),
        (lambda tracks: {**tracks, "top": tracks["left"]}, Scale("baseline", 3.5), "camera top: no lens"),
        (lambda tracks: tracks, Scale("table"), "corners in two cameras"),
        (lambda tracks: tracks, Scale("wand", 0.4), "too little of the wand"),
        (lambda tracks: tracks, Scale("gravity"), "gravity|free flight"),
        (
            lambda tracks: {**tracks, "right": replace(tracks["right"], t_us=tracks["right"].t_us + 10**8)},
            Scale("baseline", 3.5),
            "too little at the same time",
        ),
        (lambda tracks: {**tracks, "right": PointTrack.of([], [])}, Scale("baseline", 3.5), "too little at the same"),
    ],
)
def test_what_cannot_be_calibrated_is_one_clear_error(spoil, scale: Scale, says: str) -> None:
    with pytest.raises(CalibrationError, match=says):
        calibrate(spoil(sweep(CAMERAS, BallSwing(2.0))), LENSES, scale, config=QUICK)


def test_detections_of_two_different_things_do_not_pass_for_one() -> None:
    rng = np.random.default_rng(0)
    other = BallSwing(3.0, turns_hz=(1.31, 0.71, 0.53), phases_rad=(2.0, 1.0, 0.0))
    tracks = {
        "left": seen_by(CAMERAS["left"], BallSwing(3.0), rng, noise_px=0.4),
        "right": seen_by(CAMERAS["right"], other, rng, noise_px=0.4),
    }
    with pytest.raises(CalibrationError, match=r"fit together|no pose|in front"):
        calibrate(tracks, LENSES, Scale("baseline", 3.5), config=QUICK)
