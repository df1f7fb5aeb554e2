from pathlib import Path

import numpy as np
import pytest

from core.physics.points_file import PointsFileError, read_points_file

pytestmark = pytest.mark.numeric


def points_of(tmp_path: Path, text: str) -> tuple[np.ndarray, np.ndarray]:
    path = tmp_path / "points.csv"
    path.write_text(text, encoding="utf-8")
    found = read_points_file(path)
    return found.t_s, found.ps_m


def test_times_and_places_are_read_by_the_names_of_their_columns(tmp_path: Path) -> None:
    t_s, ps = points_of(tmp_path, "\ufeffx_m, t_s,note,z_m,y_m\n1.5,0.25,a,0.3,-0.1\n\n-1e-1,0.250002,b,3,+4\n")
    np.testing.assert_array_equal(t_s, [0.25, 0.250002])
    np.testing.assert_array_equal(ps, [[1.5, -0.1, 0.3], [-0.1, 4.0, 3.0]])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "an empty file"),
        ("t_s,x_m,y_m\n", "columns are missing"),
        ("t_s,x_m,y_m,z_m\n", "there are no points"),
        ("t_s,x_m,y_m,z_m\n1,2,3\n", "row 2: wrong number of cells; expected 4, got 3"),
        ("t_s,x_m,y_m,z_m\n1,2,3,x\n", "row 2: z_m is not a number"),
        ("t_s,x_m,y_m,z_m\n1,nan,3,4\n", "x_m is not a number"),
        ("t_s,x_m,y_m,z_m\n1,2,-1e9,4\n", "y_m is no place at a table"),
        ("t_s,x_m,y_m,z_m\n1,2,3,4\n1,2,3,4\n", "row 3: times do not ascend"),
        ("t_s,x_m,y_m,z_m\n1,2,3,4\n1.0000005,2,3,4\n", "times do not ascend"),
    ],
)
def test_a_file_that_is_no_such_table_is_refused_with_its_row(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(PointsFileError, match=says):
        points_of(tmp_path, text)


def test_a_file_that_is_not_there_or_no_text_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PointsFileError, match="cannot read the points"):
        read_points_file(tmp_path / "none.csv")
    (tmp_path / "bytes.csv").write_bytes(b"t_s,x_m,y_m,z_m\n\xff\xfe\x00")
    with pytest.raises(PointsFileError, match="not a CSV file"):
        read_points_file(tmp_path / "bytes.csv")


def test_other_units_are_known_by_the_names_of_the_columns(tmp_path: Path) -> None:
    t_s, ps = points_of(tmp_path, "t_ms,x_mm,y_mm,z_mm\n250,1500,-100,300\n260,1400,-90,310\n")
    np.testing.assert_allclose(t_s, [0.25, 0.26])
    np.testing.assert_allclose(ps, [[1.5, -0.1, 0.3], [1.4, -0.09, 0.31]])
    t_s, _ = points_of(tmp_path, "t_ns,x_m,y_m,z_m\n1700000000250000000,1,2,3\n1700000000260000000,1,2,3\n")
    np.testing.assert_allclose(t_s - 1_700_000_000, [0.25, 0.26], atol=1e-6)


def test_seconds_since_1970_are_times_and_places_beyond_the_hall_are_refused(tmp_path: Path) -> None:
    t_s, ps = points_of(tmp_path, "t_s,x_m,y_m,z_m\n1700000000.5,2,3,-99.9\n")
    assert t_s[0] == 1_700_000_000.5 and ps[0, 2] == -99.9
    with pytest.raises(PointsFileError, match="for millimetres name the columns x_mm,y_mm,z_mm"):
        points_of(tmp_path, "t_s,x_m,y_m,z_m\n0,1370,200,300\n")
    with pytest.raises(PointsFileError, match=r"t_s is no time in that unit.*t_s, t_ms, t_us or t_ns"):
        points_of(tmp_path, "t_s,x_m,y_m,z_m\n1700000000500,1,2,3\n")
