"""The list of balls: its conditions, its links, and that nothing of a file is taken for HTML."""

from __future__ import annotations

import html
import re
from pathlib import Path

import numpy as np
import pytest

from app.client_session.view_link import commands_of, values_of
from app.modes.watch.ball_list import (
    BallQuery,
    balls_html,
    count_html,
    link_of_row,
    moment_link,
    scatter_html,
    selection_text,
    view_balls,
)
from app.shared.ball_index import BallIndex, BallSource
from app.state.client_state import ClientState, Configs, History, Playhead
from core.detection import DetectorConfig
from core.errors import ConfigError
from labels.balls.rows import BallRow
from labels.balls.table import joined, table_of


def index_of(rows: list[BallRow], name: str = "demo", **about) -> BallIndex:
    table = joined([("recording", name, table_of(rows), np.zeros(len(rows), np.int64))])
    source = BallSource("recording", name, Path("demo.h5"))
    return BallIndex(table, (source,), np.array([0, len(rows)]), **about)


def test_fifty_links_land_on_their_microsecond_in_each_mode_and_change_no_setting() -> None:
    rng = np.random.default_rng(0)
    rows = [
        BallRow(kind="bounce", number=number, t_us=int(t_us), method="truth")
        for number, t_us in enumerate(np.sort(rng.integers(0, 3_600_000_000, 50)))
    ]
    configs = Configs(DetectorConfig(), DetectorConfig())
    for mode in ("Watch", "Tune", "Label"):
        links = [moment_link("a b&c=d", mode, row.t_us or 0) for row in rows]
        shown = balls_html(index_of(rows).table.to_pylist(), links)
        addresses = [html.unescape(one) for one in re.findall("href='#([^']*)'", shown)]
        assert addresses == links
        for row, address in zip(rows, addresses, strict=True):
            values = values_of(address)
            state = begun = ClientState("x", ("left",), "left", Playhead(3_600_000_001), History(configs), mode="Train")
            for command in commands_of(values, state):
                state = command.apply(state, 5.0)
            assert values["recording"] == "a b&c=d"
            assert (state.mode, state.playhead.position_us(9.0)) == (mode, row.t_us)
            assert state.history == begun.history


def test_a_row_shows_what_is_known_and_a_run_has_no_link() -> None:
    known = BallRow(
        kind="stroke", number=3, speed_mps=5.678, spin_radps=61.4, spin_sigma_radps=8.2, net_z_m=0.25,
        outcome="own_half", method="ddpg",
    )  # fmt: skip
    shown = balls_html(index_of([known, BallRow(kind="flight", number=4, method="ddpg")]).table.to_pylist(), [None] * 2)
    for text in ("stroke ball 3", "5.68", "61 &plusmn; 8", "0.25", "own half", "flight ball 4", ">-<"):
        assert text in shown
    assert "href" not in shown


def test_a_name_from_a_file_is_text() -> None:
    evil = "<img src=x>'"
    shown = balls_html(
        index_of([BallRow(kind=evil, number=1, t_us=1, method=evil, outcome=evil)], evil).table.to_pylist(),
        [moment_link(evil, "Watch", 1)],
    )
    assert "<img" not in shown and "src=x>'" not in shown
    assert "<img" not in count_html(index_of([], failed={"a": evil}), 0, 0)


def test_conditions_select_and_half_of_one_is_refused() -> None:
    found = index_of([BallRow(kind="flight", number=n, speed_mps=float(n), method="truth") for n in range(20)])
    assert view_balls(BallQuery(found, "speed_mps=3..5")).rows.tolist() == [3, 4, 5]
    assert "<b>20</b> of 20 rows, 13 to 20 shown" in view_balls(BallQuery(found, "", first=999)).count
    with pytest.raises(ConfigError, match="not a condition"):
        view_balls(BallQuery(found, "speed_m"))


def test_points_and_table_show_the_same_and_a_lasso_narrows_the_table_alone() -> None:
    rows = [
        BallRow(kind="flight", number=n, t_us=n, speed_mps=float(n), net_z_m=0.1 * n, method="truth") for n in range(20)
    ]
    found = index_of([*rows, BallRow(kind="flight", number=20, t_us=20, method="truth")])
    view = view_balls(BallQuery(found, "number=5..", selected=np.array([2, 7, 9])))
    assert view.scatter.rows.tolist() == list(range(5, 20)), "what has no speed has no place"
    assert view.rows.tolist() == [7, 9] and view.table.count("<a ") == 2
    assert (
        "1 not drawn: speed or height at the net not known" in view.scatter.legend
        and "data-rallyscope-balls" in scatter_html(view)
    )
    assert link_of_row(BallQuery(found, "", mode="Tune"), 7) == moment_link("demo", "Tune", 7)


def test_a_selection_is_said_in_words() -> None:
    index, line = index_of([]), np.zeros(0, np.int64)
    assert selection_text(BallQuery(index, " ")) == "all balls"
    assert selection_text(BallQuery(index, "kind=net ")) == "conditions kind=net"
    said = selection_text(BallQuery(index, "kind=net", selected=line))
    assert said == "conditions kind=net and a line drawn round points (speed, m/s across, height at the net, m up)"
