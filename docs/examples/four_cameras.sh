#!/usr/bin/env bash
# Four event files -> calibrated rig -> one recording -> labels, the ball in space from all cameras, a Rerun file.
# Usage: four_cameras.sh FOLDER. The four cameras are simulated here; with your own files begin at the first `import`.
set -euo pipefail
out=${1:?a folder for the results}
run=${RALLYSCOPE:-$(dirname "$0")/../../.venv/bin/rallyscope}
mkdir -p "$out"
here=$(cd "$(dirname "$0")" && pwd)

# What four cameras at the corners of a table see of two serves, as RAW files of each camera.
$run simulate --cameras corners --sensor 640x360 --serves 2 --speed 9 --seed 4 --out "$out/simulated.h5" --force
$run export "$out/simulated.h5" --evt3 "$out/raw" --force

# Calibrate: the lenses are those of corners.toml, the table's corners were clicked in Watch. Two serves are enough of a
# sweep here. A longer one through the whole volume is better, and may be another recording than the rally.
$run import "$out/raw" "$out/sweep.h5" --calibration "$here/corners.toml" --force
$run calibrate rig "$out/sweep.h5" --table-corners "$here/corners.csv" --click-sigma-px 0.1 --same-clock \
  --instants 100 --out "$out/rig.toml"

# One recording with the new poses. Add --offset-us 0,120,0,0 if the clock of the second file is 120 us behind.
$run import "$out"/raw/{far_left,far_right,near_left,near_right}.raw "$out/rally.h5" --calibration "$out/rig.toml" --force

# Labels of one camera: every 20th position of the detector, to be checked in Label (`serve --data FOLDER/labels`).
$run detect "$out/rally.h5" --camera far_left --out "$out/ball.csv"
awk -F, -v OFS=, 'NR == 1 {print "t_us,state,x_px,y_px,r_px"} NR % 20 == 2 {print $1, "visible", $2, $3, $4}' \
  "$out/ball.csv" > "$out/labels.csv"
$run labels import "$out/labels.csv" "$out/rally.h5" --format csv --camera far_left --annotator me --data "$out/labels"

# The ball in space, from every camera that sees it; the column `cameras` says which ones a point is made of.
$run track "$out/rally.h5" --out "$out/track.csv"
$run export "$out/rally.h5" --rrd "$out/rally.rrd" --annotator me --data "$out/labels" --end-us 300000 --stride-us 20000 --force
