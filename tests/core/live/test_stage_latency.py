"""Where the time of a command goes, by stage."""

import math
from types import SimpleNamespace

import pytest

from core.chain.chain import StageSeconds
from core.live.live_flight import QueuedCommand
from core.live.live_snapshot import STAGES, stage_latencies


def command(window_s: float = 100.0) -> QueuedCommand:
    step = SimpleNamespace(chain=SimpleNamespace(seconds=StageSeconds(0.001, 0.002, 0.003)), control_s=0.004)
    return QueuedCommand("s", SimpleNamespace(), window_s, 100.010, 0.0005, step, 100.025)  # type: ignore[arg-type]


def test_the_stages_of_a_command_add_up_to_its_latency() -> None:
    stages = dict(zip(STAGES, command().stages_ms(100.027, 100.040), strict=True))
    assert stages["window"] == pytest.approx(10) and stages["robot"] == pytest.approx(13)
    assert [stages[name] for name in ("decode", "detect", "stereo", "filter", "solve")] == pytest.approx(
        [0.5, 1, 2, 3, 4]
    )
    assert stages["queue"] == pytest.approx(15 - 10.5) and stages["send"] == pytest.approx(2)
    assert sum(stages.values()) - stages["robot"] == pytest.approx(27), "from the window's end to the sending"


def test_a_stage_that_nobody_knows_is_left_out_and_so_is_all_before_the_first_command() -> None:
    assert stage_latencies([]) == ()
    stepped = command(float("nan")).stages_ms(100.027, 100.040)
    assert math.isnan(stepped[0])
    names = [one.name for one in stage_latencies([stepped])]
    assert names == list(STAGES[1:])


def test_each_stage_has_median_p99_and_worst() -> None:
    rows = [tuple(float(number + stage) for stage in range(len(STAGES))) for number in range(100)]
    first, *_, last = stage_latencies(rows)
    assert (first.name, first.p50_ms, first.worst_ms) == ("window", pytest.approx(49.5), 99.0)
    assert first.p99_ms < first.worst_ms and last.worst_ms == 99.0 + len(STAGES) - 1
