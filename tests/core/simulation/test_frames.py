"""Pictures of a colour camera: light averaged over the exposure, against a dense average of the whole picture."""

import dataclasses

import numpy as np
import pytest

from core.cameras import stereo_preset
from core.errors import ConfigError
from core.events import SensorSize
from core.simulation import LaunchConfig, SceneConfig, draw_serve_series, pixel_truth
from core.simulation.bodies import MovingBodies, make_actors
from core.simulation.bodies.parts import REFLECTANCE, blade, rod
from core.simulation.flights import BallPath, ParabolicPath, VisibleRange
from core.simulation.frames import (
    MIN_INSTANTS,
    FrameCamera,
    FrameConfig,
    FrameTrack,
    chosen_instants,
    coloured_scenes,
    tinted_parts,
)
from core.simulation.scenes.background import make_background
from core.simulation.scenes.ball_view import ball_shading_rows
from core.simulation.scenes.block_view import view_numbers
from core.simulation.scenes.racket_view import RACKET_COLUMNS, RacketPath, RacketPoses, racket_shading_rows
from core.simulation.scenes.shading import Moving
from tests.core.simulation.body_picture import BodyPicture
from tests.dense_picture import render_light

pytestmark = pytest.mark.numeric
SCENE = SceneConfig()
CLEAN = FrameConfig(read_noise=0.0)
GONE = ParabolicPath(
    np.array([-1.0]), np.array([[0.0, 50.0, 0.1]]), np.array([[0.0, 1.0, 0.0]]), np.zeros((1, 3)), -0.5
)
"""No ball."""


class Swinging:
    """A small racket that moves across the small camera's picture."""

    radius_m = 0.04
    thickness_m = 0.03

    def at(self, t_s) -> RacketPoses:
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        p = np.array([-0.02, 0.06, 0.2]) + np.outer(t, [0.0, 0.0, 1.5])
        return RacketPoses(p, np.tile([0.9, -0.3, 0.316], (len(t), 1)))


def take(camera, config: FrameConfig, path: BallPath, racket: RacketPath | None, t_us: int, seed: int = 1):
    return FrameCamera(camera, SCENE, config, np.random.default_rng(seed)).take(path, racket, t_us)


def dense(camera, config: FrameConfig, path: BallPath, racket: RacketPath | None, t_us: int, instants: int = 400):
    """The mean light of every pixel at many instants, in levels."""
    start_us = t_us - config.exposure_us / 2
    t_s = (start_us + (np.arange(instants) + 0.5) * config.exposure_us / instants) * 1e-6
    picture, view = np.zeros((camera.sensor.height_px, camera.sensor.width_px, 3)), view_numbers(camera)
    states = path.at(t_s)
    far = VisibleRange(np.zeros((instants, 3)), np.full(instants, -np.inf))
    for channel, scene in enumerate(coloured_scenes(SCENE, config.ball_colour)):
        maps, balls = make_background(camera, scene), ball_shading_rows(camera, scene, states, far)
        rackets = np.zeros((instants, RACKET_COLUMNS))
        if racket is not None:
            rackets = racket_shading_rows(camera, scene.racket, scene.edge_px, racket, racket.at(t_s))
        out, light = np.empty(len(maps)), np.zeros(len(maps))
        for ball, row in zip(balls, rackets, strict=True):
            render_light(
                maps, view, Moving(tuple(ball.tolist()), tuple(row.tolist()), True, True, racket is not None), out
            )
            light += np.exp(out) / instants
        picture[:, :, channel] = light.reshape(picture.shape[:2])
    return 255 * np.clip(picture, 0, 1) ** (1 / config.gamma)


@pytest.mark.parametrize("exposure_us", [1000, 10_000])
@pytest.mark.parametrize("racket", [None, Swinging()])
def test_a_picture_is_the_mean_light_of_its_exposure(small_camera, crossing, exposure_us: int, racket) -> None:
    config = FrameConfig(read_noise=0.0, exposure_us=exposure_us)
    seen = take(small_camera, config, crossing, racket, 20_000)
    known = dense(small_camera, config, crossing, racket, 20_000)
    still = dense(small_camera, config, GONE, None, 20_000, instants=1)
    assert (np.abs(known - still) > 5).any(axis=2).sum() > 200, "something moves in it"
    assert np.abs(seen - known).max() < 2.0 and np.abs(seen - known).mean() < 0.4


@pytest.mark.parametrize("exposure_us", [1000, 10_000])
def test_a_streak_lies_on_the_truth_and_is_as_long_as_the_way_of_the_ball(
    small_camera, crossing, exposure_us: int
) -> None:
    config = FrameConfig(read_noise=0.0, exposure_us=exposure_us)
    bare = take(small_camera, config, GONE, None, 20_000).astype(float)
    seen = take(small_camera, config, crossing, None, 20_000).astype(float)
    cover = ((seen / 255) ** 2.2 - (bare / 255) ** 2.2)[:, :, 0]
    cover[cover < 0.01] = 0.0  # red: the ball is bright, its shadow dark
    columns, rows = np.meshgrid(np.arange(96), np.arange(72))
    u, v = (float((cover * axis).sum() / cover.sum()) for axis in (columns, rows))
    truth = pixel_truth(
        small_camera, crossing, np.array([20_000 - exposure_us // 2, 20_000, 20_000 + exposure_us // 2])
    )
    # The ball is brighter where the light comes from, by less than a tenth of its radius.
    assert np.hypot(u - truth.u_px[1], v - truth.v_px[1]) < 0.1 * truth.r_px[1]
    moved = np.hypot(truth.u_px[2] - truth.u_px[0], truth.v_px[2] - truth.v_px[0])
    spread = np.sqrt((cover * (columns - u) ** 2).sum() / cover.sum())
    # Of a disc's uniform streak: a quarter of the squared radius, and a twelfth of the squared way.
    assert spread == pytest.approx(np.sqrt(truth.r_px[1] ** 2 / 4 + moved**2 / 12), rel=0.05)


def test_a_ball_is_orange_or_white_and_the_table_blue(small_camera, crossing) -> None:
    truth = pixel_truth(small_camera, crossing, [20_000])
    u, v = round(float(truth.u_px[0])), round(float(truth.v_px[0]))
    config = FrameConfig(read_noise=0.0, exposure_us=200)
    red, green, blue = take(small_camera, config, crossing, None, 20_000)[v, u].tolist()
    assert red > green + 40 > blue + 80
    white = FrameConfig(read_noise=0.0, exposure_us=200, ball_colour="white")
    assert np.ptp(take(small_camera, white, crossing, None, 20_000)[v, u]) < 15
    camera = stereo_preset(sensor=SensorSize(64, 48))["left"]  # looks at the table
    red, green, blue = take(camera, CLEAN, GONE, None, 20_000)[24, 32].tolist()
    assert blue > green > red and blue > 1.5 * red


def test_noise_is_drawn_from_the_seed_and_as_large_as_it_says(small_camera) -> None:
    config = FrameConfig(read_noise=0.02, gamma=1.0)
    once, again, other = (take(small_camera, config, GONE, None, 20_000, seed) for seed in (1, 1, 2))
    assert np.array_equal(once, again) and not np.array_equal(once, other)
    clean = take(small_camera, FrameConfig(read_noise=0.0, gamma=1.0), GONE, None, 20_000)
    middle = (clean > 20) & (clean < 235)
    assert (once.astype(float) - clean)[middle].std() == pytest.approx(0.02 * 255, rel=0.05)


def test_the_faster_something_moves_the_more_instants_and_never_fewer_than_eight() -> None:
    assert len(chosen_instants(MIN_INSTANTS + 1)) == MIN_INSTANTS + 1
    counts = [len(chosen_instants(count)) for count in (9, 20, 100, 300)]
    assert counts == sorted(counts) and min(counts) > MIN_INSTANTS and counts[-1] > 90
    for count in (9, 23, 300):
        chosen = chosen_instants(count)
        assert chosen[0] == 0 and chosen[-1] == count - 1, "both edges of the exposure"


def test_a_track_takes_every_picture_once_when_its_exposure_is_over(small_camera, crossing) -> None:
    config = FrameConfig(rate_hz=100.0, exposure_us=4000)
    whole = FrameTrack({"a": small_camera, "b": small_camera}, SCENE, config, 5)
    all_at_once = whole.take_until(40_000, crossing)
    assert [t_us for t_us, _ in all_at_once] == [5000, 15_000, 25_000, 35_000]
    parts, track = [], FrameTrack({"a": small_camera, "b": small_camera}, SCENE, config, 5)
    for end_us, expected in ((6999, 0), (7000, 1), (20_000, 1), (40_000, 2)):
        taken = track.take_until(end_us, crossing)
        assert len(taken) == expected
        parts += taken
    for (t_us, images), (same_us, same) in zip(all_at_once, parts, strict=True):
        assert t_us == same_us and all(np.array_equal(images[name], same[name]) for name in ("a", "b"))
        assert not np.array_equal(images["a"], images["b"]), "each camera has its own noise"


def test_a_picture_is_as_bright_as_the_lamps_are_while_it_is_taken(small_camera) -> None:
    lamps = dataclasses.replace(SCENE, flicker=0.4, flicker_hz=100.0)
    linear = FrameConfig(read_noise=0.0, gamma=1.0, exposure_us=2500)
    still = take(small_camera, linear, GONE, None, 2500).astype(float)
    middle = (still > 20) & (still < 150)
    for t_us in (2500, 7500):
        seen = FrameCamera(small_camera, lamps, linear, np.random.default_rng(1)).take(GONE, None, t_us)
        swing = np.mean(1 + 0.4 * np.sin(2 * np.pi * 100e-6 * np.linspace(t_us - 1250, t_us + 1250, 1001)))
        assert (seen / np.where(middle, still, 1))[middle].mean() == pytest.approx(swing, rel=0.02)


def test_an_exposure_longer_than_the_time_between_pictures_is_refused() -> None:
    with pytest.raises(ConfigError, match="at most 16667 us at 60 Hz"):
        FrameConfig(exposure_us=20_000)


def test_skin_is_warm_shirts_are_red_blue_or_green_and_what_is_plain_stays_grey() -> None:
    skin, grey, plain = 0.45, 0.30, 0.05  # Clothes.skin; a shirt with a pattern; a blade without one
    rows = np.array([rod(0.1, 0.1, skin, texture=0.25), rod(0.1, 0.1, grey, texture=0.5), blade(0.08, plain)])
    before = rows.copy()
    red, green, blue = (tinted_parts(rows, channel)[:, REFLECTANCE] for channel in range(3))
    assert (rows == before).all(), "the parts of the event cameras keep their brightness"
    np.testing.assert_allclose((red[0], green[0], blue[0]), 0.45 * np.array([1.30, 0.95, 0.75]))
    np.testing.assert_allclose((red[1], green[1], blue[1]), 0.30 * np.array([1.60, 0.60, 0.55]))
    assert red[2] == green[2] == blue[2] == plain
    shirts = np.array([rod(0.1, 0.1, 0.01 * number, texture=0.5) for number in (30, 31, 32, 33)])
    tints = np.stack([tinted_parts(shirts, channel)[:, REFLECTANCE] for channel in range(3)], axis=1)
    assert np.argmax(tints, axis=1).tolist() == [0, 2, 1, 0]
    others = np.delete(np.arange(7), REFLECTANCE)
    assert (tinted_parts(rows, 0)[:, others] == rows[:, others]).all()


class Tinted:
    """The bodies of a scene in one colour."""

    def __init__(self, bodies: MovingBodies, channel: int) -> None:
        self.parts = tinted_parts(bodies.parts, channel)
        self.ends = bodies.ends


@pytest.mark.parametrize("t_us", [120_000, 460_000])
def test_bodies_blur_with_everything_else(t_us: int) -> None:
    camera = stereo_preset("behind", SensorSize(160, 90))["left"]
    camera = dataclasses.replace(camera, K=np.array([[125, 0, 79.5], [0, 125, 44.5], [0, 0, 1.0]]))
    bodies, path = make_actors("rally", 3), draw_serve_series([LaunchConfig()], np.random.default_rng(3))
    assert bodies is not None
    config = FrameConfig(read_noise=0.0, exposure_us=8000)
    rig = FrameCamera(camera, SCENE, config, np.random.default_rng(1), bodies)
    for before_us in (20_000, 250_000):  # what an earlier picture left behind does not show
        if before_us < t_us:
            rig.take(path, None, before_us)
    seen, known = rig.take(path, None, t_us), np.zeros((90, 160, 3))
    t_s = (t_us - 4000 + (np.arange(100) + 0.5) * 80) * 1e-6
    states, visible_range = path.at(t_s), path.visible_range(t_s)
    for channel, scene in enumerate(coloured_scenes(SCENE, "orange")):
        picture = BodyPicture(camera, scene, Tinted(bodies, channel), make_background(camera, scene))
        out = np.empty(160 * 90)
        for time_s, ball in zip(t_s, ball_shading_rows(camera, scene, states, visible_range), strict=True):
            picture.draw(float(time_s), float(ball[2]) if ball[2] > 0 else np.inf)
            picture.render(tuple(ball.tolist()), (0.0,) * RACKET_COLUMNS, False, out)
            known[:, :, channel] += np.exp(out).reshape(90, 160) / len(t_s)
    known = 255 * np.clip(known, 0, 1) ** (1 / 2.2)
    empty = dense(camera, config, GONE, None, t_us, instants=1)
    assert (np.abs(known - empty) > 20).any(axis=2).mean() > 0.03, "a good part of the picture are people"
    gap = np.abs(seen - known)
    assert gap.mean() < 0.4 and (gap > 3).mean() < 5e-3 and gap.max() < 40  # a blade that turns, in single pixels
