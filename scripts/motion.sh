#!/bin/sh
# Tables of docs/memory.md: a short finger, its model with inertia, random traces of pressure, their finite-element motions, and the errors;
# the same finger of a relaxing elastomer, whose static states are the same; and with a load across, whose base is accelerated.
#   scripts/motion.sh [FOLDER]      default: target/motion. Stopped and started again, it continues.
#   SOFTTWIN=path/to/softtwin takes a program that is already built.
set -eu
cd "$(dirname "$0")/.."
folder=${1:-target/motion}
softtwin() { ${SOFTTWIN:-cargo run --quiet --release -p softtwin --} "$@"; }
mkdir -p "$folder"
if [ ! -f "$folder/q/actuator.toml" ]; then
    (cd "$folder" && softtwin new q --chambers 4 --length-mm 48 --width-mm 10 --shear-modulus-mpa 0.2)
    softtwin mesh --actuator "$folder/q/actuator.toml" --size-mm 12.5
fi
softtwin sample --kind sequence --n 60 --regime both --pressure 0 0.04 --gap 3.5 6 --actuator "$folder/q/actuator.toml" \
    --parameter loads.gravity_mm_s2.1=-60000:40000 --out "$folder/cases.csv"
softtwin simulate --actuator "$folder/q/actuator.toml" --cases "$folder/cases.csv" --sensitivities --out "$folder/database"
softtwin train --database "$folder/database" --inertia "$folder/q/actuator.toml" --out "$folder/q.twin"
python3 scripts/motion_traces.py "$folder/traces"
set --
for trace in "$folder"/traces/*.csv; do
    name=$(basename "$trace" .csv)
    softtwin simulate --actuator "$folder/q/actuator.toml" --trace "$trace" --out "$folder/motions/$name"
    set -- "$@" "$folder/motions/$name"
done
softtwin evaluate "$folder/q.twin" --traces "$@"

mkdir -p "$folder/v" "$folder/relaxing" "$folder/across"
cp -r "$folder/q/." "$folder/v/"
sed -i 's/^prony = \[\]/prony = [{ weight = 0.2, time_s = 0.05 }]/' "$folder/v/actuator.toml"
softtwin train --database "$folder/database" --inertia "$folder/v/actuator.toml" --out "$folder/v.twin"
printf 't_s,pressure_mpa\n0,0.01\n0.01,0.03\n0.2,0.03\n' >"$folder/relaxing/free.csv"
printf 't_s,pressure_mpa,gap_mm\n0,0.01,4.6\n0.01,0.04,4.6\n0.2,0.04,4.6\n' >"$folder/relaxing/landing.csv"
set --
for name in free landing; do
    softtwin simulate --actuator "$folder/v/actuator.toml" --trace "$folder/relaxing/$name.csv" --out "$folder/relaxed/$name"
    set -- "$@" "$folder/relaxed/$name"
done
softtwin evaluate "$folder/v.twin" --traces "$@"

across=$folder/across
softtwin sample --kind sequence --n 48 --regime free --pressure 0 0.04 --actuator "$folder/q/actuator.toml" \
    --parameter loads.gravity_mm_s2.1=-60000:40000 --parameter loads.gravity_mm_s2.2=-50000:50000 --out "$across/cases.csv"
softtwin simulate --actuator "$folder/q/actuator.toml" --cases "$across/cases.csv" --sensitivities --out "$across/database"
softtwin train --database "$across/database" --inertia "$folder/q/actuator.toml" --out "$across.twin"
printf 't_s,pressure_mpa,loads.gravity_mm_s2.2\n0,0.02,0\n0.02,0.02,5000\n0.3,0.02,5000\n0.32,0.035,0\n0.6,0.035,0\n' >"$across/base.csv"
softtwin simulate --actuator "$folder/q/actuator.toml" --trace "$across/base.csv" --out "$across/motion"
softtwin evaluate "$across.twin" --traces "$across/motion"

# Stiffness from a swing: motions of a softer finger, found by a model whose inputs include the stiffness.
soft=$folder/soft
mkdir -p "$soft"
cp -r "$folder/q/." "$soft/"
sed -i 's/^mu_mpa = 0.2$/mu_mpa = 0.18/' "$soft/actuator.toml"
softtwin sample --kind sequence --n 110 --regime free --pressure 0 0.04 --actuator "$folder/q/actuator.toml" \
    --parameter loads.gravity_mm_s2.1=-60000:40000 --parameter elastomer.law.mu_mpa=0.15:0.26 --out "$soft/cases.csv"
softtwin simulate --actuator "$folder/q/actuator.toml" --cases "$soft/cases.csv" --out "$soft/database"
softtwin train --database "$soft/database" --inertia "$folder/q/actuator.toml" --out "$soft/soft.twin"
printf 't_s,pressure_mpa\n0,0.015\n0.02,0.03\n0.2,0.03\n0.22,0.015\n0.4,0.015\n0.42,0.03\n0.6,0.03\n' >"$soft/both.csv"
softtwin simulate --actuator "$soft/actuator.toml" --trace "$soft/both.csv" --out "$soft/motion"
cat >"$soft/log.toml" <<'END'
time = { column = "t_s", unit = "s" }
input = [{ name = "pressure_mpa", column = "pressure_mpa", unit = "MPa" }]
output = [
    { name = "marker1_x_mm", column = "tip_x_mm", unit = "mm" },
    { name = "marker1_y_mm", column = "tip_y_mm", unit = "mm" },
]
END
cat >"$soft/scene.toml" <<'END'
name = "soft"
[[actuator]]
name = "finger"
model = "soft.twin"
[actuator.estimate]
"elastomer.law.mu_mpa" = { prior = 0.2, sigma = 0.03 }
pressure_bias_mpa = { prior = 0.0, sigma = 0.002 }
[actuator.sigma]
pressure_mpa = 2e-5
marker_mm = 0.05
model_mm = 0.02
model_correlation_s = 0.03
[[actuator.marker]]
name = "tip"
at_mm = [48.0, 2.6, 8.0]
[actuator.source]
kind = "replay"
trace = "both.csv"
END
softtwin calibrate --scene "$soft/scene.toml" --recording "$soft/motion/series.csv" --log "$soft/log.toml"
