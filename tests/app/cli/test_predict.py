import csv
import json
from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from core.physics.config import physics_profile
from core.physics.fit_flights import simulate_flight, with_constants

pytestmark = pytest.mark.numeric
GRAVITY = 9.81


def flight(t_s: np.ndarray) -> np.ndarray:
    """A ball that bounces where the paper's prediction says it does, with its constants."""
    p, v = np.array([1.2, 0.1, 0.4]), np.array([-5.0, 0.2, 0.5])
    fall_s = (v[2] + np.sqrt(v[2] ** 2 + 2 * GRAVITY * (p[2] - 0.02))) / GRAVITY
    at = p + v * fall_s - [0, 0, GRAVITY * fall_s**2 / 2]
    after = (v - [0, 0, GRAVITY * fall_s]) * [0.82, 0.82, -0.9]
    dt = np.where(t_s < fall_s, t_s, t_s - fall_s)[:, None]
    start, speed = (np.where((t_s < fall_s)[:, None], before, then) for before, then in ((p, at), (v, after)))
    return start + speed * dt - [0, 0, GRAVITY / 2] * dt**2


def write_points(path: Path, t_s: np.ndarray, ps: np.ndarray) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["t_s", "x_m", "y_m", "z_m"])
        writer.writerows([[t, *p] for t, p in zip(t_s, ps, strict=True)])
    return path


@pytest.fixture
def points(tmp_path) -> Path:
    t_s = np.arange(0, 0.6, 0.005)
    return write_points(tmp_path / "points.csv", 7.0 + t_s, flight(t_s))


def test_the_file_has_exactly_the_keys_of_the_contract_and_comes_true(points, tmp_path, capsys) -> None:
    out = tmp_path / "pred.json"
    assert main(["predict", str(points), "--method", "paper", "--out", str(out), "--json"]) == 0
    found = json.loads(out.read_text())
    assert list(found) == ["positions", "bounces", "landing", "hit_plane"]
    later = np.arange(0.15, 0.6, 0.005)
    assert len(found["positions"]) == len(later), "one for every later row"
    for position in found["positions"]:
        assert list(position) == ["t_s", "p_world_m", "sigma_m"]
    np.testing.assert_allclose([one["t_s"] for one in found["positions"]], 7.0 + later, atol=1e-9)
    np.testing.assert_allclose([one["p_world_m"] for one in found["positions"]], flight(later), atol=2e-5)
    sigmas = np.array([one["sigma_m"] for one in found["positions"]])
    assert sigmas.shape == (len(later), 3) and (sigmas > 0).all() and sigmas[-1, 0] > sigmas[0, 0]
    assert [list(bounce) for bounce in found["bounces"]] == [["t_s", "p_world_m", "sigma_m"]] * len(found["bounces"])
    assert found["landing"] == found["bounces"][0] and found["landing"]["p_world_m"][2] == pytest.approx(0.02)
    plane = found["hit_plane"]
    assert list(plane) == ["t_s", "sigma_t_s", "p_world_m", "sigma_m", "v_world_mps", "sigma_mps", "stage"]
    assert plane["stage"] == "pre" and plane["p_world_m"][0] == -1.42
    np.testing.assert_allclose(flight(np.array([plane["t_s"] - 7.0]))[0], plane["p_world_m"], atol=2e-5)
    summary = json.loads(capsys.readouterr().out)
    assert summary["observed"] == 30 and summary["hit_plane"] == plane


def test_only_the_first_milliseconds_count(points, tmp_path) -> None:
    assert main(["predict", str(points), "--observe-ms", "100", "--out", str(tmp_path / "a.json")]) == 0
    t_s = np.arange(0, 0.6, 0.005)
    ps = flight(t_s)
    ps[t_s >= 0.1] = 9.0
    changed = write_points(tmp_path / "changed.csv", 7.0 + t_s, ps)
    assert main(["predict", str(changed), "--observe-ms", "100", "--out", str(tmp_path / "b.json")]) == 0
    assert (tmp_path / "a.json").read_text() == (tmp_path / "b.json").read_text()


def test_after_the_bounce_it_is_refined_and_the_plane_may_be_moved(points, tmp_path, capsys) -> None:
    out = tmp_path / "pred.json"
    assert main(["predict", str(points), "--observe-ms", "450", "--hit-x", "-1.3", "--out", str(out)]) == 0
    plane = json.loads(out.read_text())["hit_plane"]
    assert plane["stage"] == "post" and plane["p_world_m"][0] == -1.3
    assert "post-bounce" in capsys.readouterr().out


def test_the_physics_changes_the_bounce(points, tmp_path) -> None:
    crossings = {}
    for physics in ("paper", "real"):
        out = tmp_path / f"{physics}.json"
        assert main(["predict", str(points), "--method", "paper", "--physics", physics, "--out", str(out)]) == 0
        found = json.loads(out.read_text())
        crossings[physics] = (found["bounces"][0]["p_world_m"], found["hit_plane"]["p_world_m"][2])
    assert crossings["paper"][0] == crossings["real"][0], "the flight before it is the same"
    assert crossings["real"][1] > crossings["paper"][1], "real tables give more height back"


def test_a_ball_that_flies_away_has_no_hitting_plane(tmp_path, capsys) -> None:
    t_s = np.arange(0, 0.3, 0.005)
    away = write_points(tmp_path / "away.csv", t_s, flight(t_s) * [-1, 1, 1])
    assert main(["predict", str(away), "--out", str(tmp_path / "pred.json")]) == 0
    found = json.loads((tmp_path / "pred.json").read_text())
    assert found["hit_plane"] is None and found["landing"] is not None and len(found["positions"]) == 30
    assert "does not come" in capsys.readouterr().out


def test_the_filter_is_what_predicts_by_default_and_it_reads_what_track_writes(points, tmp_path) -> None:
    """The times of `track` are whole microseconds; both see the same points."""
    header, *rows = points.read_text().splitlines()
    tracked = tmp_path / "track.csv"
    cells = [row.split(",") for row in rows]
    lines = [",".join([str(round(1e6 * float(t))), *ps]) for t, *ps in cells]
    tracked.write_text("\n".join([header.replace("t_s", "t_us"), *lines]) + "\n")
    found = {}
    for name, path, arguments in (("a", points, []), ("b", tracked, []), ("c", points, ["--method", "filter"])):
        assert main(["predict", str(path), "--observe-ms", "148", *arguments, "--out", str(tmp_path / name)]) == 0
        found[name] = json.loads((tmp_path / name).read_text())
    assert found["a"] == found["c"]
    for key in ("t_s", "p_world_m"):
        np.testing.assert_allclose(found["b"]["hit_plane"][key], found["a"]["hit_plane"][key], atol=1e-6)


def test_the_filter_writes_the_same_contract_and_knows_the_flight(points, tmp_path) -> None:
    out = tmp_path / "pred.json"
    assert main(["predict", str(points), "--method", "filter", "--out", str(out)]) == 0
    found = json.loads(out.read_text())
    assert list(found) == ["positions", "bounces", "landing", "hit_plane"]
    assert list(found["hit_plane"]) == ["t_s", "sigma_t_s", "p_world_m", "sigma_m", "v_world_mps", "sigma_mps", "stage"]
    before_bounce = [position for position in found["positions"] if position["t_s"] < 7.3]
    for position in before_bounce:
        expected = flight(np.array([position["t_s"] - 7.0]))[0]
        np.testing.assert_allclose(position["p_world_m"], expected, atol=0.005)
        assert min(position["sigma_m"]) > 0


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "row 1: columns are missing"),
        ("t_s,x_m,y_m\n0,0,0\n", "row 1: columns are missing"),
        ("t_s,x_m,y_m,z_m\n", "no points"),
        ("t_s,x_m,y_m,z_m\n0,0,0,0\n0.1,0,zero,0\n", "row 3: y_m is not a number"),
        ("t_s,x_m,y_m,z_m\n0,0,0,nan\n", "row 2: z_m is not a number"),
        ("t_s,x_m,y_m,z_m\n0,0,0,inf\n", "row 2: z_m is not a number"),
        ("t_s,x_m,y_m,z_m\n0,0,0,0\n0.1,0,0\n", "row 3: wrong number of cells"),
        ("t_s,x_m,y_m,z_m\n0.2,0,0,0\n0.1,0,0,0\n", "row 3: times do not ascend"),
        ("t_s,x_m,y_m,z_m\n0.2,0,0,0\n0.2,0,0,0\n", "row 3: times do not ascend"),
        ("t_s,x_m,y_m,z_m\n0,0,0,0.3\n0.01,0,0,0.3\n", "too little to predict from"),
        ("\x00\x01", "points.csv"),
    ],
)
def test_a_malformed_file_is_one_line_with_file_and_row(tmp_path, capsys, text: str, says: str) -> None:
    path = tmp_path / "points.csv"
    path.write_text(text)
    assert main(["predict", str(path), "--out", str(tmp_path / "pred.json")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and says in error and "points.csv" in error
    assert not (tmp_path / "pred.json").exists()


def test_the_chosen_hit_is_added_and_the_rest_stays_as_it_was(tmp_path, capsys) -> None:
    """A slow ball is below the table's top at the plane, and is met over the table."""
    start, t_s = np.array([0.04, 0.1, 0.045, -2.41, 0.0, 1.62, 0.0, 0.0, 0.0]), np.arange(0, 0.6, 0.004)
    csv_path = write_points(tmp_path / "slow.csv", 7.0 + t_s, simulate_flight(start, t_s, physics_profile("paper")))
    plain, chosen = tmp_path / "plain.json", tmp_path / "chosen.json"
    arguments = ["predict", str(csv_path), "--physics", "paper", "--observe-ms", "300", "--out"]
    assert main([*arguments, str(plain)]) == 0
    assert main([*arguments, str(chosen), "--hit", "chosen"]) == 0
    assert "best hit in" in capsys.readouterr().out
    found = json.loads(chosen.read_text())
    added = found.pop("chosen_hit")
    assert found == json.loads(plain.read_text())
    assert list(added) == ["chosen", "why_not", "places"] and not added["why_not"]
    hit, plane = added["chosen"], found["hit_plane"]
    assert plane["p_world_m"][2] < 0.03, "below the table's top"
    assert hit["p_world_m"][0] > -1.37 and hit["t_s"] < plane["t_s"] and hit["chance"] > 0.9
    assert list(hit) == [*plane, "chance", "landing_sigma_m", "why_not"] and hit in added["places"]
    at_plane = next(one for one in added["places"] if one["p_world_m"][0] == -1.42)
    assert at_plane["why_not"] == "below the table's top" and at_plane["landing_sigma_m"] is None


def test_where_no_stroke_returns_the_ball_predict_says_why(tmp_path, capsys) -> None:
    t_s = np.arange(0, 0.4, 0.004)
    beside = simulate_flight(np.array([1.2, 0.0, 0.3, -5.0, 3.5, 0.0, 0, 0, 0]), t_s, physics_profile("paper"))
    csv_path = write_points(tmp_path / "beside.csv", t_s, beside)
    out = ["--out", str(tmp_path / "pred.json"), "--physics", "paper", "--hit", "chosen", "--json"]
    assert main(["predict", str(csv_path), *out]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["chosen_hit"] is None and "it does not bounce on the table" in summary["why_not"]


@pytest.mark.parametrize("physics", ["paper", "real"])
def test_the_filter_finds_out_by_what_physics_a_ball_flies(physics, tmp_path) -> None:
    start = np.array([1.2, 0.1, 0.3, -5.0, 0.2, 1.0, *((30.0, -80.0, 20.0) if physics == "real" else (0.0, 0.0, 0.0))])
    t_s = np.arange(0, 0.5, 0.004)
    ps = simulate_flight(start, t_s, physics_profile(physics))
    csv_path = write_points(tmp_path / "flown.csv", t_s, ps + np.random.default_rng(1).normal(0, 0.0005, ps.shape))
    off = {}
    for said in ("paper", "real", None):
        arguments = ["--physics", said] if said else []
        out = tmp_path / "pred.json"
        assert main(["predict", str(csv_path), "--method", "filter", "--out", str(out), *arguments]) == 0
        found = np.array([one["p_world_m"] for one in json.loads(out.read_text())["positions"]])
        off[said] = np.linalg.norm(found[25] - ps[t_s >= 0.15][25])  # 100 ms ahead
    wrong = "paper" if physics == "real" else "real"
    assert off[physics] < 0.02
    assert off[None] < 1.2 * off[physics] + 0.001, "nothing exact is said, and the prediction is as good"
    assert off[physics] < off[wrong]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--method", "filter", "--observe-ms", "10"], "expected points over 20 ms, got 2 points over 5 ms"),
        (["--method", "filter", "--hit-x", "7"], "--hit-x: expected"),
        (["--method", "magic"], "magic"),
        (["--observe-ms", "0"], "--observe-ms"),
        (["--observe-ms", "nan"], "--observe-ms"),
        (["--observe-ms", "20"], "--observe-ms"),
        (["--hit-x", "7"], "--hit-x: expected"),
        (["--hit-x", "nan"], "--hit-x: expected"),
    ],
)
def test_a_mistake_is_one_line_and_exit_2(points, tmp_path, capsys, arguments: list[str], says: str) -> None:
    assert main(["predict", str(points), "--out", str(tmp_path / "pred.json"), *arguments]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and says in error


def test_a_missing_file_and_a_missing_folder_are_named(points, tmp_path, capsys) -> None:
    assert main(["predict", str(tmp_path / "none.csv"), "--out", str(tmp_path / "pred.json")]) == 2
    assert "none.csv" in capsys.readouterr().err
    assert main(["predict", str(points), "--out", str(tmp_path / "nowhere" / "pred.json")]) == 2
    assert "nowhere" in capsys.readouterr().err


def test_real_flights_are_predicted_from_their_first_150_ms(shared_data, tmp_path) -> None:
    """Recorded flights between players: columns X width, Y length, Z up; turned so that they fly towards -x."""
    errors, bounces = [], 0
    files = sorted((shared_data / "trajectories" / "tt3d").glob("*.csv"))[::5]
    for file in files:
        table = np.genfromtxt(file, delimiter=",", skip_header=1)
        t_s, (x, y, z) = table[:, 0], table[:, 1:].T
        side = -1.0 if y[-1] > y[0] else 1.0
        points = write_points(tmp_path / file.name, t_s, np.column_stack([side * y, -side * x, z]))
        out = tmp_path / f"{file.stem}.json"
        assert main(["predict", str(points), "--physics", "real", "--out", str(out)]) == 0
        found = json.loads(out.read_text())
        later = t_s >= t_s[0] + 0.15
        assert len(found["positions"]) == later.sum()
        bounces += len(found["bounces"]) >= 1
        soon = t_s[later] < t_s[0] + 0.25
        truth = np.column_stack([side * y, -side * x, z])[later][soon]
        errors += [
            float(np.linalg.norm(np.array(one["p_world_m"]) - p))
            for one, p in zip(found["positions"], truth, strict=False)
        ]
    assert bounces >= 0.7 * len(files)
    assert np.median(errors) < 0.06, "no drag and no spin: centimetres within 100 ms"


def test_it_says_what_the_file_was_taken_for(points, tmp_path, capsys) -> None:
    assert main(["predict", str(points), "--out", str(tmp_path / "a.json")]) == 0
    assert "t_s in s, x_m,y_m,z_m in m; it flies" in capsys.readouterr().out
    rows = np.loadtxt(points, delimiter=",", skiprows=1)
    foreign = tmp_path / "foreign.csv"
    other = np.column_stack([rows[:, 0], -rows[:, 2], rows[:, 1], rows[:, 3]])
    np.savetxt(foreign, other, delimiter=",", header="Timestamp,X,Y,Z", comments="", fmt="%.9f")
    assert main(["predict", str(foreign), "--out", str(tmp_path / "b.json"), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert "tt3d" in summary["notes"][0] and "Timestamp in s" in summary["taken_for"]
    first, second = (json.loads((tmp_path / name).read_text())["hit_plane"] for name in ("a.json", "b.json"))
    assert second["p_world_m"] == pytest.approx(first["p_world_m"], abs=1e-5)


def test_a_flight_that_ends_within_what_is_observed_is_predicted(points, tmp_path) -> None:
    short = tmp_path / "short.csv"
    lines = points.read_text().splitlines()
    seen = [line for line in lines[1:] if float(line.split(",")[0]) < float(lines[1].split(",")[0]) + 0.12]
    short.write_text("\n".join([lines[0], *seen]))
    assert main(["predict", str(short), "--out", str(tmp_path / "pred.json")]) == 0
    found = json.loads((tmp_path / "pred.json").read_text())
    assert found["positions"] == [] and found["bounces"]


def write_constants(path: Path, drag: float, restitution: float, friction: float) -> Path:
    named = {"drag_coefficient": drag, "restitution": restitution, "friction": friction}
    report = {name: {"value": value, "sigma": 0.005} for name, value in named.items()}
    path.write_text(json.dumps(report | {"magnus_coefficient": 0.1}))
    return path


def test_fitted_constants_predict_the_world_that_they_were_fitted_to(tmp_path) -> None:
    dead = with_constants(0.1, 0.42, 0.78, 0.30)  # a table far from any published one
    t_s = np.arange(0, 0.6, 0.004)
    ps = simulate_flight(np.array([1.2, 0.05, 0.25, -4.5, 0.1, 1.0, 0, 0, 0]), t_s, dead)
    points = write_points(tmp_path / "dead.csv", t_s, ps)
    constants = write_constants(tmp_path / "constants.json", 0.42, 0.78, 0.30)
    errors_m = {}
    for name, given in (("constants", ["--constants", str(constants)]), ("nothing", [])):
        out = tmp_path / f"{name}.json"
        assert main(["predict", str(points), *given, "--out", str(out)]) == 0
        found = np.array([position["p_world_m"] for position in json.loads(out.read_text())["positions"]])
        errors_m[name] = np.linalg.norm(found - ps[-len(found) :], axis=1)[-1]
    assert errors_m["constants"] < 0.3 * errors_m["nothing"]


@pytest.mark.parametrize("also", [["--physics", "paper"], ["--method", "paper"]])
def test_the_papers_way_has_constants_of_its_own(points, also: list[str], tmp_path, capsys) -> None:
    constants = write_constants(tmp_path / "constants.json", 0.42, 0.78, 0.30)
    given = ["predict", str(points), "--out", str(tmp_path / "out.json"), "--constants", str(constants)]
    assert main([*given, *also]) == 2
    assert "--constants" in capsys.readouterr().err
