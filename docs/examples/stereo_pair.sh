#!/usr/bin/env bash
# From the event files of two cameras to a predicted ball and a file for Rerun, verb by verb.
#
#   docs/examples/stereo_pair.sh OUT LEFT.raw RIGHT.raw CALIBRATION.toml
#   docs/examples/stereo_pair.sh OUT            # on a serve that it simulates, with rig.toml beside this script
#
# OUT is a folder. What stands in it is replaced.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
rallyscope=${RALLYSCOPE:-$here/../../.venv/bin/rallyscope}
out=${1:?"usage: stereo_pair.sh OUT [LEFT.raw RIGHT.raw CALIBRATION.toml]"}
mkdir -p "$out"

told=""  # of air and table: nothing, `predict` finds out
if [ $# -ge 4 ]; then
    left=$2 right=$3 calibration=$4
else
    calibration=$here/rig.toml
    $rallyscope simulate --out "$out/simulated.h5" --serves 1 --speed 5 --cameras "$calibration" --seed 7 --force
    $rallyscope export "$out/simulated.h5" --evt3 "$out" --force
    left=$out/left.raw right=$out/right.raw told="--physics paper"
fi

# One recording of both cameras. If their clocks differ: --offset-us (see docs/use/calibration.md).
$rallyscope import "$left" "$right" "$out/pair.h5" --names left,right --calibration "$calibration" --force
# The ball in each picture: t_us,u_px,v_px,r_px. `track` below looks for it itself; these are to be looked at.
for camera in left right; do
    $rallyscope detect "$out/pair.h5" --camera "$camera" --method refined --out "$out/ball-$camera.csv"
done
# The ball in space: t_us,x_m,y_m,z_m (world).
$rallyscope track "$out/pair.h5" --method refined --out "$out/track.csv"
# Where it bounces and crosses the hitting plane, from the first 250 ms. `predict` takes one flight: of a recording with
# several, cut the rows of one out of track.csv.
$rallyscope predict "$out/track.csv" --observe-ms 250 $told --out "$out/prediction.json"
# Everything on one time axis, for Rerun.
$rallyscope export "$out/pair.h5" --rrd "$out/pair.rrd" --method refined --stride-us 20000 --force
