#!/bin/sh
# Make every picture of the manual anew: make.sh DATA FOLDER
#   DATA    folder with real/, practice/ and practice-wrong-nominal/, each case with robot.toml, log-a.parquet, log-b.parquet
#   FOLDER  for what rivet writes; draw.py reads it
# Needs `rivet` in the path. About ten minutes on two cores. From the top folder of the repository.
set -eu
data=$1 out=$2
ur10e=$data/real/ur10e_innopolis kuka=$data/real/kuka_kr300
mkdir -p "$out/cases"

# The exit codes of diagnose are verdicts.
diagnose() { rivet diagnose "$@" > /dev/null || [ $? -lt 64 ]; }

# Tutorial 1: robot file from URDF and logs, with the drive gains of robots/ur10e.
cp "$ur10e/ur10e.urdf" "$out"
rivet new "$out/ur10e.urdf" "$ur10e/20_02_10-30sec_12harm.parquet" "$ur10e/20_02_12-50sec_12harm.parquet" -o "$out/ur10e.toml" --force > /dev/null
sed -i 's|^# drive_gain = .*|drive_gain = [14.87, 13.26, 11.13, 10.62, 11.03, 11.47]|' "$out/ur10e.toml"
diagnose "$out/ur10e.toml" "$ur10e/20_02_10-30sec_12harm.parquet" "$ur10e/20_02_12-50sec_12harm.parquet" --json "$out/ur10e.json" --html "$out/ur10e.html"

# Concepts.
rivet identify robots/ur10e/robot.toml "$ur10e/20_02_12-50sec_12harm.parquet" --json "$out/id-all.json" > /dev/null
rivet identify robots/ur10e/robot.toml "$ur10e/20_01_22-joint_1.parquet" --json "$out/id-one.json" > /dev/null
rivet figures 6 7 18 --out "$out/figures.html" > /dev/null

# Effects: measured where there is one, else simulated cases.
diagnose robots/kuka-kr300-r2500/robot.toml "$kuka/traj_A_10s.parquet" "$kuka/traj_B_10s.parquet" --json "$out/kuka.json"
for set in practice practice-wrong-nominal; do
    for case in "$data/$set"/case-*; do
        diagnose "$case/robot.toml" "$case/log-a.parquet" "$case/log-b.parquet" --json "$out/cases/$set-$(basename "$case").json"
    done
done
if [ ! -d "$out/seed-6" ]; then rivet blind make --seed 6 --count 29 --out "$out/seed-6" --answers "$out/seed-6.json" > /dev/null; fi
for case in case-02 case-11 case-29; do # encoder offset, eccentricity and transmission error, which the sets above lack
    diagnose "$out/seed-6/$case/robot.toml" "$out/seed-6/$case/"*a.* "$out/seed-6/$case/"*b.* --json "$out/cases/seed-6-$case.json"
done
# No set above has base flexibility: its picture is drawn from $out/cases/base-flexibility.json, where that diagnosis was put there.
python3 docs/pictures/draw.py "$out"

# The page of a diagnosis, where there is a browser.
if command -v chromium > /dev/null; then
    chromium --headless --no-sandbox --hide-scrollbars --window-size=1280,800 --screenshot=docs/pictures/page.png "file://$(realpath "$out/ur10e.html")" > /dev/null 2>&1
fi
