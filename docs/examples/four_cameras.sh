#!/usr/bin/env bash
# Four event files -> one recording -> the ball in space from all cameras -> a Rerun file.
# Usage: four_cameras.sh FOLDER. The four cameras are simulated here; with your own files begin at `import`.
set -euo pipefail
out=${1:?a folder for the results}
run=${RALLYSCOPE:-$(dirname "$0")/../../.venv/bin/rallyscope}
mkdir -p "$out"
here=$(cd "$(dirname "$0")" && pwd)

# What four cameras at the corners of a table see of a serve, as RAW files of each camera.
$run simulate --cameras corners --serves 1 --speed 6 --seed 4 --out "$out/simulated.h5" --force
$run export "$out/simulated.h5" --evt3 "$out/raw" --force

# One recording. Names come from the files; the calibration file has cameras of these names.
$run import "$out/raw" "$out/rally.h5" --calibration "$here/corners.toml" --force
# The same with each file named, and a clock that is 120 us behind: add 120 us to the times of that camera.
$run import "$out"/raw/{far_left,far_right,near_left,near_right}.raw "$out/late.h5" --names a,b,c,d --offset-us 0,120,0,0 --force

# The ball in space, from every camera that sees it; the column `cameras` says which ones a point is made of.
$run track "$out/rally.h5" --out "$out/track.csv"
$run export "$out/rally.h5" --rrd "$out/rally.rrd" --force
