"""What the calibration of a rig writes and prints: the cameras, the errors as a picture, and the figures."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from app.cli.files import write_text
from app.cli.terminal import format_table, json_ready, say
from core.cameras import save_calibration
from core.cameras.calibration.bundle import UNKNOWNS
from core.cameras.calibration.residual_picture import ResidualPanel, residual_svg
from core.cameras.calibration.rig_result import RigCalibration, RigCamera


def write_rig(found: RigCalibration, out: Path, picture: Path | None, *, as_json: bool) -> None:
    """Write the cameras and, if it is wanted, the picture of the errors; print how good it is."""
    save_calibration(out, found.cameras)
    if picture is not None:
        write_text(picture, rig_svg(found, out.name))
    rows = [_row(name, one) for name, one in found.reports.items()]
    say(json.dumps(json_ready(_report(found, rows, out))) if as_json else _describe(found, rows, out))


def rig_svg(found: RigCalibration, title: str) -> str:
    """The reprojection errors of all cameras as a picture."""
    panels = []
    for name, one in found.reports.items():
        seen = np.isfinite(one.residuals_px[..., 0])
        panels.append(ResidualPanel(name, one.camera.sensor, one.uvs_px[seen], one.residuals_px[seen], one.used[seen]))
    views = ", what two views can see of it" if len(found.reports) == 2 else ""
    return residual_svg(f"{title}: seen minus projected{views}", panels)


def _row(name: str, one: RigCamera) -> dict[str, object]:
    errors = one.errors_px
    nothing = float("nan")
    return {
        "camera": name,
        "points": len(errors),
        "left_out": one.left_out,
        "rms_px": float(np.sqrt((errors**2).mean())) if len(errors) else nothing,
        "median_px": float(np.median(errors)) if len(errors) else nothing,
        "p95_px": float(np.percentile(errors, 95)) if len(errors) else nothing,
        "clock_ahead_us": round(one.offset_us, 1),
        "sigma_clock_us": round(one.sigma_offset_us, 1),
        "drift_ppm": round(one.drift_ppm, 2),
        "sigma_drift_ppm": round(one.sigmas.get("drift_ppm", 0.0), 2),
        "sigma_position_mm": 1e3 * one.sigma_position_m,
        "sigma_rotation_deg": float(np.degrees(one.sigma_rotation_rad)),
    }


def _lengths(found: RigCalibration) -> dict[str, dict[str, float]]:
    return {
        name: {
            "median_m": float(np.median(values)),
            "spread_percent": 100 * float(np.std(values) / np.mean(values)),
            "count": float(len(values)),
        }
        for name, values in found.lengths_m.items()
        if len(values)
    }


def _report(found: RigCalibration, rows: list[dict[str, object]], out: Path) -> dict[str, object]:
    names = list(found.reports)
    return {
        "cameras": rows,
        "offset_us": {name: -round(one.offset_us) for name, one in found.reports.items()},
        "sigma_px": found.sigma_px,
        "lead_px": found.lead_px,
        "sigma_lead_px": found.sigma_lead_px,
        "instants": len(found.t_us),
        "baseline_m": found.baseline_m,
        "sigma_baseline_m": found.sigma_baseline_m,
        "wand": _lengths(found),
        "shared": {a: {b: int(found.shared[i, k]) for k, b in enumerate(names) if k != i} for i, a in enumerate(names)},
        "scale": found.scale.origin,
        "sigma_scale": found.sigma_scale,
        "frame": found.frame,
        "click_rms_px": found.click_rms_px,
        "T_world_camera": {name: camera.T_world_camera.tolist() for name, camera in found.cameras.items()},
        "K": {name: camera.K.tolist() for name, camera in found.cameras.items()},
        "parameters": [*(f"{name}.{key}" for name in names for key in UNKNOWNS), "lead_px"],
        "sigmas": {name: one.sigmas for name, one in found.reports.items()},
        "covariance": found.covariance.tolist(),
        "notes": list(found.notes),
        "out": str(out),
    }


def _describe(found: RigCalibration, rows: list[dict[str, object]], out: Path) -> str:
    used = f"{int(found.used.sum())} of {len(found.used)} common sightings"
    lines = [
        f"{out}: {len(rows)} cameras from {used}, {found.sigma_px:.3f} px each way",
        format_table(rows),
        f"baseline {found.baseline_m:.4f} +- {found.sigma_baseline_m:.4f} m between the first two, scale from "
        f"{found.scale.origin}, known to {100 * found.sigma_scale:.2f} %",
        f"world: {found.frame}",
    ]
    lines += [
        f"markers {name}: {1e3 * one['median_m']:.1f} mm, spread {one['spread_percent']:.2f} % over {one['count']:.0f}"
        for name, one in _lengths(found).items()
    ]
    if found.sigma_lead_px > 0:
        lines.append(f"detections run {found.lead_px:.2f} +- {found.sigma_lead_px:.2f} px ahead of the ball: taken off")
    if found.click_rms_px is not None:
        lines.append(f"clicked corners: rms {found.click_rms_px:.2f} px")
    if any(one.sigma_offset_us > 0 for one in found.reports.values()):  # else the clock was said to be one
        offsets = [str(-round(one.offset_us)) for one in found.reports.values()]
        lines.append(f"clocks: `import --offset-us {','.join(offsets)}`")
    return "\n".join([*lines, *found.notes])
