import math

import numpy as np
import pytest

from benchmarks.robustness.bench_robustness import CELLS, Cell, WrongWires, wrong_cameras
from core.cameras import stereo_preset
from core.events import Events

CAMERAS = stereo_preset()
SENSOR = CAMERAS["left"].sensor


def noise(start_us: int, end_us: int, seed: int) -> Events:
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(start_us, end_us, 300))
    return Events.from_columns(t, rng.integers(0, 1280, 300), rng.integers(0, 720, 300), rng.random(300) < 0.5, SENSOR)


def blocks(wires: WrongWires, count: int) -> tuple[dict[str, Events], dict[str, Events]]:
    """What happened in some blocks of 10 ms and what came through, each as one."""
    given: dict[str, list[Events]] = {"left": [], "right": []}
    come: dict[str, list[Events]] = {"left": [], "right": []}
    for k in range(count):
        block = {name: noise(10_000 * k, 10_000 * (k + 1), 2 * k + n) for n, name in enumerate(given)}
        seen = wires.seen(block, 10_000 * k, 10_000 * (k + 1))
        for name in given:
            given[name].append(block[name])
            come[name].append(seen[name])
            assert (seen[name].t_us >= 10_000 * k).all() and (seen[name].t_us < 10_000 * (k + 1)).all()
    return tuple({name: join(parts) for name, parts in each.items()} for each in (given, come))  # pyright: ignore


def join(parts: list[Events]) -> Events:
    columns = (np.concatenate([getattr(part, name) for part in parts]) for name in ("t_us", "x_px", "y_px", "on"))
    return Events.from_columns(*columns, SENSOR)


def wires_of(cell: Cell, seed: int = 1) -> WrongWires:
    return WrongWires(cell, CAMERAS, np.random.default_rng(seed))


def test_a_late_clock_moves_every_event_of_one_camera_and_loses_none() -> None:
    given, come = blocks(wires_of(Cell(name="", words="", clock_ms=1.0)), 5)
    late = [name for name in given if not np.array_equal(given[name].t_us, come[name].t_us)]
    assert len(late) == 1
    name = late[0]
    count = len(come[name].t_us)
    np.testing.assert_array_equal(come[name].t_us, given[name].t_us[:count] + 1000)
    np.testing.assert_array_equal(come[name].x_px, given[name].x_px[:count])
    assert (given[name].t_us[count:] >= 49_000).all(), "only those that are not there yet"


def test_a_blocked_camera_sees_nothing_for_so_long_and_the_other_one_all() -> None:
    wires = wires_of(Cell(name="", words="", blocked_ms=20.0))
    wires.begin_ball(0)
    given, come = blocks(wires, 40)
    blocked = [name for name in given if len(come[name].t_us) < len(given[name].t_us)]
    assert len(blocked) == 1
    gaps = np.diff(come[blocked[0]].t_us)
    assert 20_000 <= gaps.max() < 21_000
    low = come[blocked[0]].t_us[gaps.argmax()]
    assert low + 1000 >= 50_000 and low <= 350_000
    assert len(given[blocked[0]].t_us) - len(come[blocked[0]].t_us) == pytest.approx(600, rel=0.15)


def test_a_lamp_adds_two_bursts_in_10_ms_in_both_pictures() -> None:
    given, come = blocks(wires_of(Cell(name="", words="", lamp=True)), 4)
    for name in given:
        added = len(come[name].t_us) - len(given[name].t_us)
        assert added == pytest.approx(8 * math.pi * 40**2, rel=0.02)


def test_nothing_wrong_changes_nothing() -> None:
    wires = wires_of(CELLS[0])
    wires.begin_ball(0)
    given, come = blocks(wires, 40)
    for name in given:
        for column in ("t_us", "x_px", "y_px", "on"):
            np.testing.assert_array_equal(getattr(given[name], column), getattr(come[name], column))


def test_cameras_are_wrong_by_what_the_cell_says() -> None:
    at = np.array([[-0.4, 0.0, 0.2]])
    off = wrong_cameras(Cell(name="", words="", pixels=0.5), CAMERAS, np.random.default_rng(2))
    turned = wrong_cameras(Cell(name="", words="", degrees=0.5), CAMERAS, np.random.default_rng(2))
    for name, camera in CAMERAS.items():
        assert np.linalg.norm(off[name].project(at) - camera.project(at)) == pytest.approx(0.5, abs=1e-9)
        relative = camera.T_world_camera[:3, :3].T @ turned[name].T_world_camera[:3, :3]
        assert math.degrees(math.acos((np.trace(relative) - 1) / 2)) == pytest.approx(0.5)
        np.testing.assert_array_equal(turned[name].position_world_m, camera.position_world_m)


def test_rows_have_names_of_their_own_and_only_told_ones_are_told() -> None:
    assert len({cell.name for cell in CELLS}) == len(CELLS) == len({cell.words + cell.told for cell in CELLS})
    assert [cell.name for cell in CELLS if cell.told] == ["told"]
