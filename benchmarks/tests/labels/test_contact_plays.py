from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.labels.contact_plays import (
    PlayContacts,
    draw_net_ball,
    errors_of,
    kept_detections,
    score_play,
    seen_found,
    table_of,
)
from core.physics import PhysicsConfig
from core.simulation.flights import FlightSeries
from core.simulation.truth import ball_truth, truth_times
from labels.contacts import contacts_of_truth
from labels.model import ContactKind, ContactLabel

BOUNCE, HIT, NET = ContactKind


def test_balls_meet_the_net_first_and_some_of_them_pass_over_its_edge() -> None:
    passed = 0
    for seed in range(12):
        ball = draw_net_ball(0.2, np.random.default_rng(seed), PhysicsConfig())
        path = FlightSeries((ball,))
        kinds = [one.kind for one in contacts_of_truth(ball_truth(path, truth_times(path, 0, int(path.end_s * 1e6))))]
        assert kinds[0] is NET and set(kinds[1:]) <= {BOUNCE}
        passed += bool(ball.v_world_mps[0, 0] * ball.v_world_mps[1, 0] > 0)
    assert 0 < passed < 12


def test_detections_of_a_play_are_made_once(tmp_path: Path) -> None:
    file = tmp_path / "plays" / "drawn-7.npz"
    made = kept_detections(file, 7, events=False)
    kept = kept_detections(file, 8, events=False)
    assert [part.x_px.tolist() for part in kept] == [part.x_px.tolist() for part in made]
    assert [path.name for path in file.parent.iterdir()] == [file.name]
    play = score_play(7, made)
    assert not play.people and {one.kind for one in play.truth} == {BOUNCE, HIT, NET}
    assert len(play.seen) == len(play.truth)


def test_recall_precision_and_what_both_cameras_see_are_counted_over_plays() -> None:
    def contact(t_us: int, kind: ContactKind) -> ContactLabel:
        return ContactLabel(t_us=t_us, kind=kind)

    truth = (contact(100_000, BOUNCE), contact(300_000, NET), contact(500_000, HIT))
    first = PlayContacts(2, True, truth, (contact(100_200, BOUNCE), contact(300_400, BOUNCE)), (2, 2, 0))
    second = PlayContacts(3, False, truth[:1], (contact(100_000, BOUNCE), contact(700_000, HIT)), (2,))
    assert errors_of(first) == ["missed hit at 500000 us, seen by 0", "net at 300000 us called bounce"]
    assert errors_of(second) == ["false hit at 700000 us"]
    assert seen_found([first, second]) == (3, 3)
    rows = {tuple(cell.strip() for cell in line.split("|")[1:3]): line for line in table_of([first, second])}
    assert "| 3 of 4 | 75.0 %" in rows["both", "all"] and "| 3 of 4, 75.0 % | 0.20 ms |" in rows["both", "all"]
    assert "| 2 of 2 |" in rows["both", "bounce"] and "| 2 of 3, 66.7 % |" in rows["both", "bounce"]
    assert "| 0 of 1 |" in rows["both", "net"] and "| 1 of 1 |" in rows["no", "all"]
