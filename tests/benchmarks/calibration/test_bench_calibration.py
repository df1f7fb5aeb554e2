import pytest

from benchmarks.calibration.bench_calibration import error_row, rig_row


def number(value: object) -> float:
    assert isinstance(value, float)
    return value


def test_errors_in_space_grow_with_the_error_of_the_calibration() -> None:
    rows = [error_row("side", level_px, 0.0, "both", draws=6) for level_px in (0.0, 0.1, 0.5)]
    medians = [number(row["3d_median_mm"]) for row in rows]
    assert medians[0] < 1e-6 and 0 < 3 * medians[1] < medians[2] < 5
    assert number(rows[2]["3d_p95_mm"]) > medians[2]


def test_noise_alone_is_what_the_pixels_cost() -> None:
    row = error_row("side", 0.0, 0.4, "both", draws=4)
    assert number(row["3d_median_mm"]) == pytest.approx(1.2, abs=0.4)


@pytest.mark.parametrize("swept", ["swing", "serves"])
def test_a_rig_from_a_sweep_is_near_the_true_one(swept: str) -> None:
    row = rig_row("side", swept, events=False, seeds=(0,))
    assert abs(number(row["clock_us"])) < 100 and number(row["3d_median_mm"]) < 4
    assert number(row["turned_deg"]) < 0.1 and number(row["reprojection_px"]) < 2
