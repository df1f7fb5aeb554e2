"""Flights in the units, columns and orders of strangers: read right, or refused with what would be right."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from core.physics.fit_flights import read_flight_file
from core.physics.points_file import PointsFile, PointsFileError, read_points_file

pytestmark = pytest.mark.numeric
Array = np.ndarray


def flight(count: int = 90) -> tuple[Array, Array]:
    """A ball that comes towards the robot with 5 m/s and bounces once; 3 mm noise."""
    t = np.arange(count) / 120
    hit = (0.5 + np.sqrt(0.25 + 2 * 9.81 * 0.33)) / 9.81
    after = t - hit
    z = np.where(after < 0, 0.35 + 0.5 * t - 4.905 * t**2, 0.02 + 0.85 * (9.81 * hit - 0.5) * after - 4.905 * after**2)
    ps = np.column_stack([1.3 - 5 * t, 0.1 + 0.3 * t, z])
    return t, ps + np.random.default_rng(0).normal(0, 0.003, ps.shape)


T, PS = flight()


def table(header: str, t: Array = T, ps: Array = PS, mark: str = ",") -> str:
    rows = [mark.join(f"{number:.17g}" for number in (a, *b)) for a, b in zip(t, ps, strict=True)]
    return "\n".join([header, *rows]) + "\n"


PLAIN = table("t_s,x_m,y_m,z_m")
LINES = PLAIN.splitlines()
MORE_COLUMNS = "\n".join([f"{LINES[0]},confidence", *(f"{line},0.5" for line in LINES[1:])])


def read(tmp_path: Path, text: str) -> PointsFile:
    path = tmp_path / "flight.csv"
    path.write_bytes(text.encode())
    return read_points_file(path)


@pytest.mark.parametrize(
    ("text", "start_s"),
    [
        (PLAIN, 0),
        (table("t_ms,x_mm,y_mm,z_mm", 1e3 * T, 1e3 * PS), 0),
        (table("t_us,x_cm,y_cm,z_cm", 1e6 * T, 1e2 * PS), 0),
        (table("t_s,x_m,y_m,z_m", T + 1.7e9), 1.7e9),
        (table("t_ms,x_m,y_m,z_m", 1e3 * (T + 1.7e9)), 1.7e9),
        (table("t_us,x_m,y_m,z_m", 1e6 * (T + 1.7e9)), 1.7e9),
        (table("Time [ms],x (mm),y (mm),z (mm)", 1e3 * T, 1e3 * PS), 0),
        (table("timestamp_us,pos_x_m,pos_y_m,pos_z_m", 1e6 * T), 0),
        (table("t,x,y,z"), 0),
        (table("time,X,Y,Z", 1e3 * T, 1e3 * PS), 0),
        (table("timestamp,px,py,pz", 1e9 * T), 0),
        (table("time,x,y,z", 1e3 * (T + 1.7e9)), 1.7e9),
        (table("t,x,y,z", 1e6 * T, 1e2 * PS), 0),
        (table("t_s,x_in,y_in,z_in", T, PS / 0.0254), 0),
        (table("time (s),x (inch),y (inch),z (inch)", T, PS / 0.0254), 0),
        (table("t_s,x_ft,y_ft,z_ft", T, PS / 0.3048), 0),
        ("\ufeff" + PLAIN.replace("\n", "\r\n"), 0),
        ("# " + PLAIN, 0),
        (table("t_s;x_m;y_m;z_m", mark=";").replace(".", ","), 0),
        (table("t_s\tx_m\ty_m\tz_m", mark="\t"), 0),
        (table("Timestamp,X,Y,Z", T, PS[:, [1, 0, 2]] * (-1, 1, 1)), 0),
        ("\n".join([LINES[0], *LINES[:0:-1]]), 0),
        ("\n".join([*LINES[:20], LINES[21], LINES[20], *LINES[22:]]), 0),
        (PLAIN.replace("\n", "\n0.001,nan,0,0\n0.002,,,\n", 1), 0),
        (f"sep=;\n# made by a tool\n{table('t_s;x_m;y_m;z_m;', mark=';').replace('.', ',')}", 0),
        ("# t_s x_m y_m z_m\n" + table("", mark=" ")[1:], 0),
        (PLAIN.replace("\n", ",\n"), 0),
    ],
)
def test_the_same_flight_is_read_from_every_form(tmp_path: Path, text: str, start_s: float) -> None:
    found = read(tmp_path, text)
    np.testing.assert_allclose(found.t_s - start_s, T, atol=2e-6)
    np.testing.assert_allclose(found.ps_m, PS, atol=1e-9)
    assert "it flies 5.1 m/s" in found.taken_for


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (table("t_s,x_m,y_m,z_m", 1e3 * T), "times multiplied by 0.001"),
        (table("t_s,x_m,y_m,z_m", 1e6 * T), "times multiplied by 1e-06"),
        (table("t_us,x_m,y_m,z_m"), r"times multiplied by 1e\+06"),
        (table("t_s,x_mm,y_mm,z_mm"), "places multiplied by 1000"),
        (table("t_s,x_m,y_m,z_m", T, 1e3 * PS), "name the columns x_mm,y_mm,z_mm"),
        (table("t_s,x_m,y_m,z_m", T, 1e2 * (PS - PS.mean(axis=0) / 2)), "x_cm|multiplied by 0.01"),
        (table("t_s,x_m,y_m,z_m", 1e6 * (T + 1.7e9)), "name the column after its unit"),
        (table("t,x,y,z", T[:6], PS[:6]), "units of t,x,y,z cannot be told"),
        # Inches: was read as cm, in which it falls with 3.9 m/s2.
        (table("t,x,y,z", T, PS / 0.0254), "times in s and places in cm or times in s and places in inches"),
        (table("t,x,y,z", T, 1e-3 * PS), "none in which they fly as a ball does"),
        (PLAIN + "\n".join(LINES[1:]), "row 92: times do not ascend.*one flight"),
        ("t_s,x_m,y_m,z_m\n" + "0.1,nan,nan,nan\n" * 200 + "\n".join(LINES[1:]), "row 2: x_m is not a number"),
        (table("frame,x_m,y_m,z_m"), "columns are missing"),
        (table("t_s,x_m,y_m,z"), "columns are missing"),
        ("\n".join(LINES[1:]), "columns are missing"),
    ],
)
def test_what_cannot_be_right_is_refused_with_what_would_be(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(PointsFileError, match=said):
        read(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (table("t,x,y,z"), "times in s and places in m: only so the points fly as a ball does"),
        (table("t_s,x_m,y_m,z_m", T, PS[:, [1, 0, 2]]), "flies along y"),
        (table("t_s,x_m,y_m,z_m", T, PS * (1, 1, -1)), "is z up"),
        (table("t_s,x_m,y_m,z_m", T, 3.28 * PS), "the unit right"),
        (table("t_s,x_m,y_m,z_m", T, PS * (-1, 1, 1)), "away from the robot"),
        (table("t_s,x_m,y_m,z_m", T, 0 * PS), "hardly moves"),
        (PLAIN + "\n".join(table("", T + 5).splitlines()[1:]), "several flights"),
        ("\n".join([LINES[0], *LINES[:0:-1]]), "sorted"),
        (PLAIN.replace("\n", "\n0.001,nan,0,0\n", 1), "1 of 91 rows without a number are left out"),
        (
            PLAIN.replace("\n", "\n0.001,nan,0,0\n" + "0.001,,,\n" * 89, 1),
            "90 of 180 rows without a number are left out",
        ),
        (table("Timestamp,X,Y,Z", T, PS[:, [1, 0, 2]] * (1, -1, 1)), "turned half round"),
    ],
)
def test_what_is_odd_is_read_and_said(tmp_path: Path, text: str, said: str) -> None:
    assert said in "; ".join(read(tmp_path, text).notes)


@pytest.mark.parametrize(
    ("encoding", "header"),
    [("utf-16", "t_s;x_m;y_m;z_m;größe"), ("utf-16-le", "t_s;x_m;y_m;z_m"), ("latin-1", "t_s;x_m;y_m;z_m;größe")],
)
def test_a_flight_is_read_in_any_encoding(tmp_path: Path, encoding: str, header: str) -> None:
    rows = table(header, mark=";").replace(".", ",").replace("\n", ";\n") if "ö" in header else table(header, mark=";")
    (tmp_path / "flight.csv").write_bytes(rows.replace(header + ";", header).encode(encoding))
    np.testing.assert_allclose(read_points_file(tmp_path / "flight.csv").ps_m, PS, atol=1e-9)


def with_rows(*odd: str, lines: list[str] = LINES) -> str:
    """The flight with odd rows behind its 31st, each a few rows after the one before."""
    rows = list(lines)
    for number, row in enumerate(odd):
        rows.insert(31 + 5 * number, row)
    return "\n".join(rows) + "\n"


UNSAID = table("t,x,y,z", 1e3 * T, 1e3 * PS).splitlines()
ODD = {
    "an outlier": (with_rows("0.2501,99,0.1,0.3"), "no ball can get there from the points before and after"),
    "outliers": (with_rows("0.2501,99,0.1,0.3", "0.292,0,0,-99"), "2 of 92 rows left out: no ball can get there"),
    "an outlier, no units": (with_rows("251,99000,100,300", lines=UNSAID), "no ball can get there"),
    "beyond the hall": (with_rows("0.2501,0.1,1e9,0.3"), "y_m is no place at a table"),
    "a repeated time": (with_rows(LINES[30].split(",")[0] + ",0.05,0.1,0.3"), "times do not ascend"),
    "a copy": (with_rows(LINES[30]), "1 of 91 rows left out: copies of the row before"),
    "a short row": (with_rows("0.2501,0.1"), "wrong number of cells; "),
    "a text": (with_rows("0.2501,0.1,ERR,0.3"), "y_m is not a number"),
    "an infinite value": (with_rows("0.2501,0.1,-inf,0.3"), "y_m is not a number"),
    "a time of 0": (with_rows("0,0.1,0.1,0.3"), "t_s is far from the others"),
    "a time of a day later": (with_rows("86400.25,0.1,0.1,0.3"), "t_s is far from the others"),
    "a last time of a day later": (PLAIN + "86400.25,0.1,0.1,0.3\n", "t_s is far from the others"),
    "a remark": (with_rows("# lost here"), ""),
}


@pytest.mark.parametrize("name", ODD)
def test_one_odd_row_is_left_out_and_said(tmp_path: Path, name: str) -> None:
    text, said = ODD[name]
    found = read(tmp_path, text)
    np.testing.assert_allclose(found.t_s, T, atol=1e-9)
    np.testing.assert_allclose(found.ps_m, PS, atol=1e-9)
    notes = "; ".join(found.notes)
    assert said in notes and ("row" in notes) == bool(said)


def test_one_stray_time_at_the_end_of_a_short_flight_is_left_out(tmp_path: Path) -> None:
    """Thirteen rows may have one odd row, the last; ten times these 92 ms are less than a second."""
    found = read(tmp_path, "\n".join(LINES[:13]) + "\n86400.25,0.1,0.1,0.3\n")
    np.testing.assert_allclose(found.t_s, T[:12], atol=1e-9)
    assert "1 of 13 rows left out: t_s is far from the others" in found.notes[0]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (table("t_s,x_m,y_m,z_m").replace(".", ","), "90 of 90 rows are so: decimal commas between commas"),
        (MORE_COLUMNS.replace(".", ","), "90 of 90 rows are so: decimal commas between commas"),
        (with_rows(*["0.25,ERR,0,0"] * 12), "12 of 102 rows are so"),
        (table("t_s,x_m,y_m,z_m", np.floor(T * 60) / 60), "times have too few digits"),
        (table("t_s,x_m,y_m,z_m", T, np.where(np.arange(90)[:, None] % 7 == 0, 1e4, PS)), "for millimetres name"),
    ],
)
def test_many_odd_rows_are_refused_with_the_likeliest_cause(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(PointsFileError, match=said):
        read(tmp_path, text)


def test_a_plain_file_has_no_remarks_and_fit_physics_reads_the_same(tmp_path: Path) -> None:
    assert read(tmp_path, PLAIN).notes == ()
    flown, points = read_flight_file(tmp_path / "flight.csv")
    assert np.array_equal(flown.ps_m, points.ps_m) and flown.t_s[0] == 0


def test_rows_at_the_origin_are_no_positions(tmp_path: Path) -> None:
    places = PS.copy()
    places[[0, 10, 40]] = 0
    found = read(tmp_path, table("t_s,x_m,y_m,z_m", T, places))
    assert len(found.t_s) == len(T) - 3 and not (found.ps_m == 0).all(axis=1).any()
    assert "3 of 90 rows at 0,0,0 left out: that stands for no position" in found.notes


def test_flights_that_a_column_tells_apart_are_refused(tmp_path: Path) -> None:
    def numbered(numbers: str) -> str:
        rows = [f"{line},{number}" for line, number in zip(LINES[1:], numbers * 45, strict=True)]
        return "\n".join([f"{LINES[0]},ball", *rows])

    assert len(read(tmp_path, numbered("11")).t_s) == len(T)
    with pytest.raises(PointsFileError, match="several flights in one file; expected one value, got ball = 1, 2"):
        read(tmp_path, numbered("12"))
