"""Seeds that are trained side by side are those that come one after the other, whatever happens to a worker."""

import os
import signal
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import psutil
import pytest

from core.errors import ConfigError
from core.jobs import ALONE, JobBackend
from core.learning.config import CurriculumConfig, EnvironmentConfig, RunConfig
from core.learning.runs.run_files import Control, create_run, read_lines, read_status, seed_files, write_control
from core.learning.runs.running import run_training
from tests.sizes import BROWSER_TIMEOUT_S
from tests.waiting import eventually

SEEDS = (4, 5, 6)
CONFIG = RunConfig(
    environment=EnvironmentConfig(state_source="truth"),
    curriculum=CurriculumConfig(speeds_mps=(3.0, 5.0), episodes=(70, 60)),
    checkpoint_every=20,
    evaluation_balls=20,
    first_seed=SEEDS[0],
    seeds=len(SEEDS),
)
TWO = JobBackend(jobs=2)


def files_of(run: Path) -> dict[str, bytes]:
    """All that a run has written but how it was controlled and watched."""
    return {
        str(path.relative_to(run)): path.read_bytes()
        for seed in SEEDS
        for path in seed_files(run, seed).folder.rglob("*")
        if path.is_file()
    }


@pytest.fixture(scope="module")
def in_turn(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    run = tmp_path_factory.mktemp("runs") / "in-turn"
    create_run(run, CONFIG)
    assert run_training(run, engine=ALONE) == "finished"
    return files_of(run)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    create_run(tmp_path / "run", CONFIG)
    return tmp_path / "run"


def episodes(run: Path, seed: int) -> int:
    return len(read_lines(seed_files(run, seed).metrics)[0])


def state_of(run: Path) -> str:
    status = read_status(run)
    return "" if status is None else status.state


def wait_for_status(run: Path) -> None:
    """Wait until the pause has been reported once more, or is over."""
    path = run / "status.json"
    before_ns = path.stat().st_mtime_ns
    eventually(lambda: path.stat().st_mtime_ns > before_ns or state_of(run) != "paused", "another status")


def test_they_are_the_same_to_the_last_byte(run: Path, in_turn: dict[str, bytes]) -> None:
    shares: list[float] = []
    assert run_training(run, engine=TWO, progress=shares.append) == "finished"
    assert files_of(run) == in_turn
    assert shares == sorted(shares) and shares[-1] == 1.0
    status = read_status(run)
    assert status is not None and (status.state, status.share, status.pid) == ("finished", 1.0, os.getpid())


@pytest.mark.gate
@pytest.mark.timeout(BROWSER_TIMEOUT_S)  # workers are started twice, and one seed begins anew
def test_a_worker_that_is_killed_costs_nothing(run: Path, in_turn: dict[str, bytes]) -> None:
    killed: list[int] = []

    def kill() -> None:
        eventually(lambda: min(episodes(run, seed) for seed in SEEDS[:2]) > 25, "two seeds to be trained")
        for child in psutil.Process().children(recursive=True):
            if "resource_tracker" not in " ".join(child.cmdline()):
                killed.append(child.pid)
                child.send_signal(signal.SIGKILL)
                break
        write_control(run, Control())

    write_control(run, Control(episodes_per_s=40.0))
    with ThreadPoolExecutor(1) as aside:
        killing = aside.submit(kill)
        assert run_training(run, engine=TWO) == "finished"
        killing.result()
    assert killed and files_of(run) == in_turn


def test_who_is_told_to_stop_saves_and_goes_on_later(run: Path, in_turn: dict[str, bytes]) -> None:
    def begun() -> bool:
        return episodes(run, SEEDS[0]) > 10

    assert run_training(run, engine=TWO, stopped=begun) == "stopped"
    status = read_status(run)
    assert status is not None and status.state == "stopped" and status.share < 1
    assert seed_files(run, SEEDS[0]).checkpoint.exists(), "also between two checkpoints"
    assert run_training(run, engine=TWO) == "finished"
    assert files_of(run) == in_turn


def test_a_pause_holds_all_of_them(run: Path, in_turn: dict[str, bytes]) -> None:
    counts: list[tuple[int, ...]] = []

    def pause() -> None:
        eventually(lambda: episodes(run, SEEDS[1]) > 10, "the second seed to be trained")
        write_control(run, Control("pause"))
        eventually(lambda: state_of(run) == "paused", "the pause")
        # A seed reads of the pause after its episode: until then its lines grow from one status to the next.
        while len(counts) < 2 or counts[-1] != counts[-2]:
            wait_for_status(run)
            counts.append(tuple(episodes(run, seed) for seed in SEEDS))
        write_control(run, Control("run"))

    write_control(run, Control(episodes_per_s=20.0))
    with ThreadPoolExecutor(1) as aside:
        pausing = aside.submit(pause)
        assert run_training(run, engine=TWO) == "finished"
        pausing.result()
    assert counts[-1] == counts[-2] and sum(counts[-1]) < len(SEEDS) * CONFIG.episodes
    assert files_of(run) == in_turn


def test_seeds_that_share_a_backend_are_not_trained_side_by_side(run: Path) -> None:
    class Backend:
        pass

    with pytest.raises(ConfigError, match="a backend each"):
        run_training(run, engine=TWO, backend=Backend())  # type: ignore[arg-type]
    assert read_status(run) is None


def test_a_disk_that_refuses_is_one_line_and_the_run_is_failed(run: Path) -> None:
    if os.geteuid() == 0:
        blocked = seed_files(run, SEEDS[1]).folder
        blocked.write_text("a file where a folder should be")
    else:
        run.chmod(0o500)
    with pytest.raises(ConfigError, match="cannot be written"):
        run_training(run, engine=TWO)
    status = read_status(run)
    assert status is not None and status.state == "failed" and "cannot be written" in status.message


def test_a_run_that_fails_on_the_way_says_how_far_it_was(tmp_path: Path) -> None:
    run = tmp_path / "long"  # else it may be over before anybody has looked
    create_run(run, replace(CONFIG, curriculum=CurriculumConfig(speeds_mps=(3.0, 5.0), episodes=(2000, 2000))))

    def fail() -> bool:
        status = read_status(run)
        if status is not None and status.share > 0.05:
            raise ValueError("cut off")
        return False

    with pytest.raises(ValueError, match="cut off"):
        run_training(run, engine=TWO, stopped=fail)
    status = read_status(run)
    assert status is not None and (status.state, status.message) == ("failed", "ValueError: cut off")
    assert 0.05 < status.share < 1


def test_one_seed_needs_nobody_else(tmp_path: Path) -> None:
    create_run(tmp_path / "one", replace(CONFIG, seeds=1))
    before = {child.pid for child in psutil.Process().children(recursive=True)}
    seen: list[set[int]] = []
    run_training(
        tmp_path / "one",
        engine=TWO,
        progress=lambda share: seen.append({child.pid for child in psutil.Process().children(recursive=True)}),
    )
    assert seen and all(pids <= before for pids in seen)
