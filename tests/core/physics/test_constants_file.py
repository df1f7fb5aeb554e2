"""Constants that were fitted to flights: read from a report, used by filters."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from core.chain.config import ChainConfig, chain_with_constants
from core.errors import ConfigError
from core.physics.constants_file import read_constants
from core.physics.task import task_profile
from core.trajectory.learned_constants import nothing_learned

REPORT: dict[str, Any] = {
    "drag_coefficient": {"value": 0.41, "sigma": 0.005},
    "restitution": {"value": 0.88, "sigma": 0.004},
    "friction": {"value": 0.3, "sigma": 0.02},
    "magnus_coefficient": 0.12,
    "flights": {"fit": 4, "test": 2},
}


def write(folder: Path, report: object) -> Path:
    path = folder / "constants.json"
    path.write_text(report if isinstance(report, str) else json.dumps(report))
    return path


def test_a_report_gives_the_physics_of_a_task(tmp_path: Path) -> None:
    constants = read_constants(write(tmp_path, REPORT))
    task = task_profile("paper", constants)
    assert task.stroke == task_profile("real").stroke
    air, table = task.physics.air, task.physics.table
    assert (air.drag_coefficient, air.magnus_coefficient) == (0.41, 0.12)
    assert (table.restitution, table.friction) == (0.88, 0.3)
    assert task.physics.rubber == task_profile("real").physics.rubber


def test_a_chain_begins_with_them_and_goes_on_learning(tmp_path: Path) -> None:
    chain = chain_with_constants(ChainConfig(), read_constants(write(tmp_path, REPORT)))
    learned = nothing_learned(chain.filter)
    assert learned.means.tolist() == [0.41, 0.88, 0.3]
    assert learned.sigmas.tolist() == pytest.approx([0.005, 0.004, 0.02])
    assert learned.balls == 0
    (without, _), (through, odds), *_ = learned.kinds(chain.filter)
    assert without.drag == 0.0 and without.restitution == 0.88
    assert through.drag == 0.41 and through.drag_sigma > chain.filter.drag_scatter and odds > 0.1
    assert nothing_learned(ChainConfig().filter).means.tolist() != learned.means.tolist()


def test_a_constant_may_be_known_without_a_spread(tmp_path: Path) -> None:
    report = REPORT | {"friction": {"value": 0.3, "sigma": 0}}
    assert read_constants(write(tmp_path, report)).friction.sigma == 0


@pytest.mark.parametrize(
    ("report", "says"),
    [
        ("drag = 0.4", "JSON"),
        ([1, 2], "JSON"),
        ({key: value for key, value in REPORT.items() if key != "friction"}, "no `friction`"),
        (REPORT | {"restitution": 0.9}, "no `restitution`"),
        (REPORT | {"restitution": {"value": "0.9", "sigma": 0.1}}, "restitution.value"),
        (REPORT | {"restitution": {"value": 0.9, "sigma": -0.1}}, "spread"),
        (REPORT | {"drag_coefficient": {"value": 4.0, "sigma": 0.1}}, "drag_coefficient"),
        ('{"drag_coefficient": {"value": NaN, "sigma": 1}}', "drag_coefficient.value"),
    ],
)
def test_what_is_no_report_is_refused_by_its_cause(report: object, says: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"constants\.json") as refused:
        read_constants(write(tmp_path, report))
    assert says in str(refused.value)
