#!/usr/bin/env python3
"""The table of the NI-LIO paper beside simulated drives along the same paths, and loop closure over whole drives.

  paper_table.py FOLDER_OF_PROGRAMS [--work FOLDER] [--page docs/results/loops.md] [--minutes 90]
Drapes KITTI's true poses, simulates a drive along them at --realism typical, replays it with and without IMU, injects drift
into the finished run, and measures. A drive is deleted when its rows are done, unless it has a false loop. --work keeps the
rows; a row that is there is not repeated. --minutes begins no drive afterwards: with 0 the page of the rows so far is written.
Without --page it is printed.
Exit status 3: a false loop. 77: no poses (NILIO_DATA, or --poses), no python3-numpy.
"""
import argparse
import datetime
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time

try:
    import numpy

    import loops
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

SENSORS = {"hdl64e": "HDL-64E", "vlp16": "VLP-16", "vls128": "VLS-128"}
BEAMS = {"hdl64e": 64, "vlp16": 16, "vls128": 128}
# Simulated along these sequences alone: as many points again as two HDL-64E.
SEQUENCES_OF = {"vls128": ["06"]}
parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("programs", type=pathlib.Path)
parser.add_argument("--sequences", nargs="+", default=["07", "06", "09", "05", "04", "00", "02", "08"])
parser.add_argument("--sensors", nargs="+", choices=list(SENSORS), default=list(SENSORS))
parser.add_argument("--imu", nargs="+", choices=["on", "off"], default=["on", "off"])
parser.add_argument("--length", help="only the first metres of each drive")
parser.add_argument("--minutes", type=float)
parser.add_argument("--poses", type=pathlib.Path, help="folder with KITTI's pose files 00.txt to 10.txt; default: below NILIO_DATA")
parser.add_argument("--work", type=pathlib.Path)
parser.add_argument("--page", type=pathlib.Path)
parser.add_argument("--commit", help="of the programs; default: that of this file")
options = parser.parse_args()
HERE = pathlib.Path(__file__).resolve().parent
# Injected heading drift in degrees per 100 m and error of the scale in per cent.
DRIFTS = {"none": None, "0.5° in 100 m": ("0.5", "0"), "0.5° in 100 m, 1 %": ("0.5", "1")}
METHODS = ("NI-LIO", "A-LOAM", "LeGO-LOAM", "FAST-LIO2")
# Published for real KITTI: APE m, RPE m of each method; path length m, that of the truth first.
PUBLISHED = {
    "00": (("2.24", "1.003"), ("3.30", "1.213"), ("6.61", "6.919"), ("12.58", "1.376")),
    "04": (("0.25", "0.027"), ("0.38", "0.042"), ("0.41", "0.084"), ("3.77", "2.415")),
    "05": (("1.43", "0.290"), ("2.47", "1.195"), ("4.58", "7.272"), ("7.09", "1.253")),
    "06": (("1.07", "1.630"), ("2.18", "3.588"), ("2.85", "9.246"), ("14.99", "1.651")),
    "07": (("0.37", "0.013"), ("0.49", "0.015"), ("0.87", "0.057"), ("1.97", "1.223")),
    "09": (("3.48", "0.687"), ("9.41", "1.550"), ("14.30", "8.865"), ("5.84", "1.570")),
}
PUBLISHED_PATHS = {
    "04": ("393.645", "393.665", "392.303", "393.100", "417.112"),
    "05": ("2205.576", "2202.121", "2201.596", "2170.236", "2200.661"),
    "07": ("694.697", "695.342", "697.431", "699.066", "696.498"),
}
PAGE = """# Loop closure over whole drives

Made by

```sh
{command}
```

at commit {commits}, {date}: {done} of {wanted} rows{missing}.

**Real** columns hold what the NI-LIO paper publishes for the recordings of KITTI, without loop closure. **Simulated** columns and rows are nilio on drives that `nilio simulate --realism typical
--moving-start` makes along the same true paths, with the heights of revisits made equal ([drape.py](../../tests/map/drape.py)) and one pose in 0.1037 s: the path is KITTI's; streets, traffic and errors
of the sensors are simulated, with one seed. Simulated worlds are mostly planar, which flatters every plane metric: a simulated column does not rank nilio against the methods of the real ones.

APE: root mean square position error after alignment by a rigid motion (SE(3), no scale). RPE: root mean square of the translation error from scan to scan (0.1 s) for nilio; the paper does not state
its step, so that even their order of magnitude may differ. Path length: sum of the distances from pose to pose; that of the truth at the same times. All by `nilio evaluate`.

## The paper's table

### APE, m

{ape}

### RPE, m

{rpe}

### Path length, m

{path}

## Loop closure

A submap is revisited if its middle was within 4 m of an earlier place at least 60 m back on the path, and closed if a loop of it is accepted. False: wrong by more than 0.5 m or 2°. Drift is injected into
the finished run by moving keyframes and surfaces (`nilio-bend-map`), only with IMU. Time: search, verification and pose graph, mean of a submap, on a computer with other work. Refused: candidates by
[reason](../map.md#loop-closure). Error² / variance: mean of the squared errors over the variances, of the odometry between submaps (model without biases, which are injected drift) and of
the translation of loops; 1 for a correct covariance. Poses: scans that were degraded or lost.

All rows: {totals}.

{by_sensor}

{loops}
"""


def run(program, *arguments, allowed=(0,)):
    done = subprocess.run([options.programs / program, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode not in allowed:
        sys.exit(f"{program} {' '.join(map(str, arguments))}: exit status {done.returncode}\n{done.stderr}{done.stdout}")


def true_path(sequence, work):
    """Draped pose file of a sequence."""
    draped = work / f"draped_{sequence}.txt"
    if not draped.exists():
        poses = work / f"{sequence}.txt"
        if options.poses:
            shutil.copy(options.poses / poses.name, poses)
        else:
            with tarfile.open(archive()) as tar:
                member = next(m for m in tar.getmembers() if m.name.endswith(poses.name))
                poses.write_bytes(tar.extractfile(member).read())
        subprocess.run([sys.executable, HERE / "drape.py", poses, draped], check=True, capture_output=True)
    return draped


def archive():
    return pathlib.Path(os.environ.get("NILIO_DATA", HERE.parents[1] / "../shared/data")) / "kitti/odometry_poses_00-10.tar.xz"


def simulated(sequence, sensor, work):
    """Folder of the drive; one of an interrupted simulation is begun again."""
    drive = work / "drives" / f"{sequence}_{sensor}"
    if not drive.exists():
        part = drive.with_suffix(".part")
        shutil.rmtree(part, ignore_errors=True)
        part.parent.mkdir(exist_ok=True)
        extent = ["--length", options.length] if options.length else []
        run("nilio", "simulate", part, "--sensor", sensor, "--trajectory", true_path(sequence, work), "--pose-interval", "0.1037",
            "--realism", "typical", "--moving-start", *extent)
        part.rename(drive)
    return drive


def replayed(drive, imu, work):
    output = work / "runs" / f"{drive.name}_{imu}"
    if not (output / "result.json").exists():
        # 3: tracking was lost, which the page shows.
        run("niliod", "--replay", drive, "--output", output, "--force", "--set", "publisher.enabled=false",
            *(["--set", "imu.enabled=false"] if imu == "off" else []), allowed=(0, 3))
    return output


def measured(truth, output, drift):
    """Figures of a row."""
    result = loops.evaluate(options.programs, truth, output, DRIFTS[drift])
    loops.report(f"{output.name}, drift {drift}", result)
    counters = json.loads((output / "latency.json").read_text())["counters"]
    figures = {key: {"ape": loops.ape(result[key]), "rpe": result[key]["rpe"]["translation_m"]["rmse"], "path": result[key]["path"]}
               for key in ("odometry", "optimised")}
    kept = ("reference", "moving", "error_m", "error_deg", "false", "nees", "overlap", "support_share", "contradiction", "ambiguity")
    return figures | {key: result[key] for key in ("submaps", "seconds", "revisits", "refused", "edge_nees")} | {
        "poses": {state: counters["poses_" + state] for state in ("tracking", "degraded", "lost")},
        "loops": [{key: loop[key] for key in kept} for loop in result["accepted"]]}


def wanted_rows():
    """Sequence, sensor, IMU, drift in the order in which they are made."""
    return [(sequence, sensor, imu, drift) for sensor in options.sensors
            for sequence in options.sequences if sequence in SEQUENCES_OF.get(sensor, [sequence])
            for imu in options.imu for drift in (DRIFTS if imu == "on" else ["none"])]


def file_of(row, work):
    sequence, sensor, imu, drift = row
    return work / "rows" / f"{sequence}_{sensor}_{imu}_{list(DRIFTS).index(drift)}.json"


def make_rows(work):
    """Makes the rows that are not there, one drive after the other."""
    (work / "rows").mkdir(parents=True, exist_ok=True)
    begin = time.monotonic()
    for sequence, sensor in dict.fromkeys(row[:2] for row in wanted_rows()):
        missing = [row for row in wanted_rows() if row[:2] == (sequence, sensor) and not file_of(row, work).exists()]
        if not missing or options.minutes is not None and time.monotonic() - begin >= 60 * options.minutes:
            continue
        drive = simulated(sequence, sensor, work)
        false = 0
        for row in missing:
            figures = measured(drive / "truth.tum", replayed(drive, row[2], work), row[3])
            false += sum(loop["false"] for loop in figures["loops"])
            figures["commit"] = options.commit
            part = file_of(row, work).with_suffix(".part")
            part.write_text(json.dumps(figures, indent=1))
            part.rename(file_of(row, work))
        if false:
            print(f"{sequence}, {sensor}: {false} false loops; drive and runs are kept in {work}", file=sys.stderr)
            continue
        for folder in (drive, *(work / "runs" / f"{drive.name}_{imu}" for imu in options.imu)):
            shutil.rmtree(folder, ignore_errors=True)


def table(header, rows):
    return "\n".join("| " + " | ".join(map(str, row)) + " |" for row in (header, ["---"] * len(header), *rows))


def paper_table(rows, published, figure, digits):
    """One quantity: published columns, then those of the simulated drives with IMU."""
    sensors = [sensor for sensor in options.sensors if "on" in options.imu and sensor not in SEQUENCES_OF]
    simulated_path = figure == "path"
    header = ["sequence", *(["real: truth"] if simulated_path else []), *(f"real: {method}" for method in METHODS)]
    for sensor in sensors:
        header += [f"simulated, {SENSORS[sensor]}, IMU: {name}" for name in
                   (["truth"] if simulated_path else []) + ["nilio odometry", "nilio with loops"]]
    lines = []
    for sequence in PUBLISHED:
        line = [sequence, *published(sequence)]
        for sensor in sensors:
            row = rows.get((sequence, sensor, "on", "none"))
            values = []
            if row and simulated_path:
                values = [row["odometry"]["path"]["truth_m"], *(row[key]["path"]["estimate_m"] for key in ("odometry", "optimised"))]
            elif row:
                values = [row[key][figure] for key in ("odometry", "optimised")]
            line += [f"{value:.{digits}f}" for value in values] or ["not run"] * (3 if simulated_path else 2)
        lines.append(line)
    return table(header, lines)


def loop_table(rows):
    lines = []
    for (sequence, sensor, imu, drift), row in sorted(rows.items(), key=lambda item: item[0][0]):
        errors = [1000 * loop["error_m"] for loop in row["loops"]]
        false = sum(loop["false"] for loop in row["loops"])
        closed = ", ".join(f"{closed} of {count} {kind}" for kind, (closed, count) in row["revisits"].items())
        refused = sorted(row["refused"].items(), key=lambda item: (-item[1], item[0]))
        states = row["poses"]
        lines.append([f"{sequence}, {row['odometry']['path']['truth_m'] / 1000:.1f} km", SENSORS[sensor], "yes" if imu == "on" else "no",
                      drift, closed or "no revisit", len(errors), f"**{false}**" if false else 0,
                      f"{numpy.median(errors):.0f} / {max(errors):.0f}" if errors else "-",
                      f"{row['odometry']['ape']:.2f}, {row['optimised']['ape']:.2f}", f"{row['seconds'] / row['submaps']:.2f}",
                      ", ".join(f"{count} {reason}" for reason, count in refused) or "-",
                      f"{numpy.mean(row['edge_nees']):.2f}, " +
                      (f"{numpy.mean([loop['nees'][0] for loop in row['loops']]):.2f}" if errors else "-"),
                      f"{states['degraded']} / {states['lost']}"])
    return table(["drive", "LiDAR", "IMU", "injected drift", "revisited submaps closed", "loops", "false", "error of loops, median / maximum, mm",
                  "APE before, after, m", "time, s", "refused", "error² / variance: odometry, loops", "poses degraded / lost"], lines)


def totals(rows):
    accepted = [loop for row in rows.values() for loop in row["loops"]]
    closed, revisited = numpy.sum([counts for row in rows.values() for counts in row["revisits"].values()] or [[0, 0]], 0)
    return f"{closed} of {revisited} revisited submaps closed, {sum(loop['false'] for loop in accepted)} of {len(accepted)} loops false"


def sensor_table(rows):
    """Recall, precision and cost by the number of beams and by the direction of the revisit."""
    lines = []
    for sensor in options.sensors:
        of_sensor = [row for key, row in rows.items() if key[1] == sensor]
        if not of_sensor:
            continue
        kinds = {}
        for kind, counts in ((kind, counts) for row in of_sensor for kind, counts in row["revisits"].items()):
            kinds[kind] = numpy.add(kinds.get(kind, [0, 0]), counts)
        loops_of_sensor = [loop for row in of_sensor for loop in row["loops"]]
        right = sum(not loop["false"] for loop in loops_of_sensor)
        lines.append([f"{SENSORS[sensor]}, {BEAMS[sensor]} beams", len(of_sensor),
                      *(f"{kinds[kind][0]} of {kinds[kind][1]}" if kind in kinds else "-" for kind in ("same", "oblique", "reverse")),
                      f"{right} of {len(loops_of_sensor)}",
                      f"{sum(row['seconds'] for row in of_sensor) / sum(row['submaps'] for row in of_sensor):.2f}"])
    return table(["LiDAR", "rows", "closed, same direction", "oblique", "reverse", "loops right", "time of a submap, s"], lines)


def page(work):
    rows = {row: json.loads(file_of(row, work).read_text()) for row in wanted_rows() if file_of(row, work).exists()}
    missing = [f"{sequence} {SENSORS[sensor]}{'' if imu == 'on' else ' without IMU'}"
               for sequence, sensor, imu, drift in wanted_rows() if (sequence, sensor, imu, drift) not in rows]
    arguments = [name for key in ("sequences", "sensors", "imu") if getattr(options, key) != parser.get_default(key)
                 for name in ("--" + key, *getattr(options, key))]
    arguments += ["--length", options.length] if options.length else []
    return PAGE.format(
        command=" ".join(["tests/map/paper_table.py build/release/bin --work WORK --page docs/results/loops.md", *arguments]),
        commits=", ".join(sorted({row["commit"] for row in rows.values()})), date=datetime.date.today(), done=len(rows), wanted=len(wanted_rows()),
        missing="; not run: " + ", ".join(dict.fromkeys(missing)) if missing else "",
        ape=paper_table(rows, lambda s: [ape for ape, _ in PUBLISHED[s]], "ape", 2),
        rpe=paper_table(rows, lambda s: [rpe for _, rpe in PUBLISHED[s]], "rpe", 4),
        path=paper_table(rows, lambda s: PUBLISHED_PATHS.get(s, ["-"] * 5), "path", 1),
        totals=totals(rows), by_sensor=sensor_table(rows), loops=loop_table(rows)), rows


def main(work):
    make_rows(work)
    text, rows = page(work)
    if options.page:
        options.page.write_text(text)
    else:
        print(text)
    false = [" ".join(row) for row, figures in rows.items() if any(loop["false"] for loop in figures["loops"])]
    if false:
        print("false loops: " + "; ".join(false), file=sys.stderr)
    return 3 if false else 0


if not options.poses and not archive().exists():
    print("skipped: no data")
    sys.exit(77)
options.commit = options.commit or subprocess.run(["git", "-C", HERE, "rev-parse", "--short", "HEAD"], capture_output=True,
                                                  text=True).stdout.strip()
with tempfile.TemporaryDirectory() as temporary:
    # Rows of another length are others.
    sys.exit(main((options.work or pathlib.Path(temporary)) / (f"first_{options.length}_m" if options.length else ".")))
