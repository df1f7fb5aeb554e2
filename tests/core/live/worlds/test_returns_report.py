"""The page about balls of human play."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from core.live.worlds.simulated_returns import (
    PlayedFile,
    ReturnOutcome,
    SimulatedReturns,
    SimulatedReturnsConfig,
    losses,
    report_rows,
    write_ball_states_report,
)
from core.physics.task import task_profile
from core.simulation.episodes import draw_serves
from core.simulation.episodes.incoming import Incoming

pytestmark = pytest.mark.numeric
CONFIG = SimulatedReturnsConfig(task=task_profile("real"))


def test_rows_and_losses_add_up_and_the_page_has_them(tmp_path: Path) -> None:
    serves = draw_serves(6.0, 20, CONFIG.task, np.random.default_rng(3))
    fates = np.full(20, ReturnOutcome.RETURNED, np.int8)
    fates[:5], fates[5:7] = ReturnOutcome.NOT_PLAYABLE, ReturnOutcome.NET
    incoming = np.where(fates == ReturnOutcome.NOT_PLAYABLE, Incoming.TWO_BOUNCES, Incoming.PLAYABLE).astype(np.int8)
    errors_m = np.where(fates == ReturnOutcome.RETURNED, 0.05, np.nan)
    file = PlayedFile("human", serves, SimulatedReturns(fates, incoming, np.zeros(20, np.bool_), errors_m))
    rows = report_rows([file, file])
    assert [row["count"] for row in rows["files"]] == [20, 20]
    for name in ("speeds", "spins"):
        assert sum(int(str(row["count"])) for row in rows[name]) == 40, "every ball is in one bin"
        assert sum(int(str(row["returned"])) for row in rows[name]) == 26
    row = rows["files"][0]
    assert (row["playable"], row["returned"], row["share"]) == (15, 13, pytest.approx(13 / 15))
    assert row["error_mm_median"] == pytest.approx(50.0)
    assert losses(file.played) == {"two bounces before the hitting plane": 5, "struck into the net": 2}
    write_ball_states_report(tmp_path / "page.md", [file], CONFIG, "the command")
    page = (tmp_path / "page.md").read_text()
    assert "the command" in page and "| human | 20 | 15 | 13 | 86.7 [" in page and "images/page.svg" in page
    picture = (tmp_path / "images" / "page.svg").read_text()
    assert picture.endswith("</svg>\n") and "87 %" in picture and "of 15" in picture
