import numpy as np
import pytest

from benchmarks.detector_training import crops
from benchmarks.detector_training.crops import (
    BallStreak,
    draw_batch,
    draw_crop,
    draw_streak,
    other_light,
    random_streak,
)
from benchmarks.detector_training.pool import LabelledPictures, TrainingPictures

SIDE = 96


def picture(x: float, y: float, r: float) -> np.ndarray:
    return draw_streak(np.full((180, 320, 3), 30, np.uint8), BallStreak(x_px=x, y_px=y, r_px=r, light=(1.0, 1.0, 1.0)))


def centre_of(image: np.ndarray) -> np.ndarray:
    """Of what is bright, from the picture's corner; linear light."""
    light = (image[:, :, 0] / 255.0) ** 2.2
    light = np.where(light > 0.05, light, 0.0)
    y, x = np.mgrid[: image.shape[0], : image.shape[1]] + 0.5
    return np.array([(x * light).sum(), (y * light).sum()]) / light.sum()


@pytest.mark.parametrize("motion", [(0.0, 0.0), (14.0, -6.0)])
def test_a_drawn_ball_lies_where_it_is_said_to_in_the_middle_of_its_motion(motion: tuple[float, float]) -> None:
    streak = BallStreak(x_px=40.3, y_px=25.8, r_px=6.0, motion_px=motion, light=(1.0, 1.0, 1.0), ambient=1.0)
    drawn = draw_streak(np.zeros((60, 80, 3), np.uint8), streak)
    assert centre_of(drawn) == pytest.approx([40.3, 25.8], abs=0.1)
    area = (drawn[:, :, 0] > 0).sum()
    assert area == pytest.approx(np.pi * 36 + 12 * np.hypot(*motion), rel=0.3)


def test_a_ball_at_the_edge_is_cut_off_and_one_outside_changes_nothing() -> None:
    dark = np.full((20, 30, 3), 7, np.uint8)
    assert (draw_streak(dark, BallStreak(x_px=0.0, y_px=0.0, r_px=5.0))[:3, :3] > 7).any()
    assert np.array_equal(draw_streak(dark, BallStreak(x_px=200.0, y_px=90.0, r_px=5.0)), dark)
    assert (dark == 7).all()


def test_random_balls_lie_in_the_picture() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        one = random_streak(SIDE, rng)
        assert one.r_px <= one.x_px <= SIDE - one.r_px and one.r_px <= one.y_px <= SIDE - one.r_px


def test_the_ball_of_a_crop_lies_where_the_crop_says_however_it_is_cut(monkeypatch) -> None:
    monkeypatch.setattr(crops, "DRAWN", 0.0)
    monkeypatch.setattr(crops, "other_light", lambda image, rng: image)
    rng, circle = np.random.default_rng(1), np.array([201.4, 77.7, 7.0])
    image, seen = picture(*circle), 0
    for _ in range(60):
        crop, balls = draw_crop(image, circle, SIDE, rng)
        assert crop.shape == (SIDE, SIDE, 3)
        for x, y, r in balls:
            assert 0.7 * 7 < r < 1.6 * 7
            if 2 * r < min(x, y) and max(x, y) < SIDE - 2 * r:
                near = np.ascontiguousarray(crop[int(y - 2 * r) : int(y + 2 * r), int(x - 2 * r) : int(x + 2 * r)])
                found = centre_of(near) + np.array([int(x - 2 * r), int(y - 2 * r)])
                assert found == pytest.approx([x, y], abs=0.8)
                seen += 1
    assert seen > 15


def test_a_picture_without_a_ball_has_none_in_its_crops(monkeypatch) -> None:
    monkeypatch.setattr(crops, "DRAWN", 0.0)
    nothing = np.full(3, np.nan)
    rng = np.random.default_rng(2)
    assert all(draw_crop(picture(50, 50, 5), nothing, SIDE, rng)[1] == [] for _ in range(20))


def test_a_batch_depends_on_its_generator_alone_and_names_its_crops() -> None:
    pictures = LabelledPictures(np.stack([picture(100, 90, 6)] * 3), np.array([[100.0, 90.0, 6.0]] * 3))
    pool = TrainingPictures((pictures, pictures))
    one, other = (draw_batch(pool, pool.rows(), 16, SIDE, np.random.default_rng(3)) for _ in range(2))
    assert np.array_equal(one.images, other.images) and np.array_equal(one.circles, other.circles)
    assert one.images.shape == (16, SIDE, SIDE, 3) and len(pool) == 6
    assert set(one.circles[:, 0]) <= set(range(16)) and len(one.circles) > 8


def test_another_light_leaves_the_given_picture_as_it_is() -> None:
    image = picture(100, 90, 6)
    before = image.copy()
    lit = [other_light(image, np.random.default_rng(seed)).mean() for seed in range(20)]
    assert np.array_equal(image, before) and max(lit) > 1.3 * before.mean() > 1.3 * 0.9 * min(lit)
