"""Ball states of human play: read, and turned into the world frame."""

import json
from pathlib import Path

import numpy as np
import pytest

from core.errors import RecordingError
from core.physics import Serves
from core.physics.ball_states import KEYS, read_ball_states, write_ball_states

pytestmark = pytest.mark.numeric
STATE = dict(zip(KEYS, (0.1, 1.2, 0.3, -0.2, -5.0, 1.0, 30.0, 4.0, -7.0), strict=True))


def written(path: Path, *states: dict[str, float]) -> Path:
    path.write_text(json.dumps([{"id": number, **state} for number, state in enumerate(states)]))
    return path


def test_a_state_is_turned_so_that_the_robot_plays_at_negative_x(tmp_path: Path) -> None:
    found = read_ball_states(written(tmp_path / "a.json", STATE))
    np.testing.assert_allclose(found.ps_m[0], [1.2, -0.1, 0.3])
    np.testing.assert_allclose(found.vs_mps[0], [-5.0, 0.2, 1.0])
    np.testing.assert_allclose(found.spins_radps[0], [4.0, -30.0, -7.0])


def test_what_is_written_is_read_as_it_was_with_where_it_is_from(tmp_path: Path) -> None:
    states = np.arange(18.0).reshape(2, 9) / 10 * np.array([1, 1, 1, -1, 1, 1, 1, 1, 1])
    serves = Serves(states[:, :3], states[:, 3:6], states[:, 6:])
    write_ball_states(tmp_path / "a.json", serves, [{"name": "one", "t_us": 2**53 + 1}, {"name": "two", "t_us": None}])
    np.testing.assert_allclose(read_ball_states(tmp_path / "a.json").states(), states)
    assert json.loads((tmp_path / "a.json").read_text())[0]["t_us"] == 2**53 + 1
    with pytest.raises(RecordingError, match="cannot write"):
        write_ball_states(tmp_path, serves, [{}, {}])


def test_a_ball_that_flies_the_other_way_is_turned_half_round_and_does_the_same(tmp_path: Path) -> None:
    turned = STATE | {key: -STATE[key] for key in KEYS if not key.endswith("z")}
    one, other = (read_ball_states(written(tmp_path / "a.json", state)) for state in (STATE, turned))
    np.testing.assert_allclose(one.states(), other.states())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not JSON"),
        ("{}", "no list of ball states"),
        ("[]", "no list of ball states"),
        ("[" * 100_000, "not JSON"),
        ("[3]", "not a ball state"),
        ('[{"pos_x": 1}]', "not a ball state"),
        (json.dumps([STATE | {"pos_x": "0.1"}]), "not a ball state"),
        (json.dumps([STATE | {"pos_x": True}]), "not a ball state"),
        (json.dumps([STATE, STATE | {"vel_y": float("nan")}]), "state 1: no possible ball"),
        (json.dumps([STATE | {"pos_z": 50.0}]), "no possible ball"),
        (json.dumps([STATE | {"vel_x": 10**400}]), "no possible ball"),
    ],
)
def test_what_is_no_list_of_ball_states_is_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.json"
    path.write_text(text)
    with pytest.raises(RecordingError, match=message) as error:
        read_ball_states(path)
    assert "bad.json" in str(error.value) and "\n" not in str(error.value) and len(str(error.value)) < 700


@pytest.mark.parametrize(
    ("keys", "largest"),
    [(("pos_x",), 5.0), (("pos_z",), 5.0), (("vel_x", "vel_y"), 40.0), (("w_vel_y", "w_vel_z"), 1500.0)],
)
def test_a_ball_may_be_at_the_limit_of_what_is_possible_but_not_beyond(
    tmp_path: Path, keys: tuple[str, ...], largest: float
) -> None:
    """Of a position each coordinate counts, of a velocity and a spin the length."""
    still = dict.fromkeys(KEYS, 0.0)
    share = (-0.6, 0.8) if len(keys) == 2 else (-1.0,)
    for factor in (1.0, 1.001):
        state = still | {key: part * largest * factor for key, part in zip(keys, share, strict=True)}
        path = written(tmp_path / "a.json", STATE, state)
        if factor == 1.0:
            assert len(read_ball_states(path)) == 2
        else:
            with pytest.raises(RecordingError, match="state 1: no possible ball"):
                read_ball_states(path)


def test_a_missing_or_too_large_file_is_said_so(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot read"):
        read_ball_states(tmp_path / "none.json")
    large = tmp_path / "large.json"
    with large.open("wb") as file:
        file.truncate((64 << 20) + 1)
    with pytest.raises(RecordingError, match="too large"):
        read_ball_states(large)
